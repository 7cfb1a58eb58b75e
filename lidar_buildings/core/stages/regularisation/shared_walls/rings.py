"""Buildings put together from faces, in the coordinates that their outlines had."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

#: Vertices that lie no farther than this from the line between their neighbours say nothing [grid cells].
MAX_BEND = 1.5


def merged_rings(
    faces: NDArray[np.object_],
    owner: NDArray[np.int64],
    polygons: NDArray[np.object_],
    kept: NDArray[np.float64],
    grid: float,
) -> NDArray[np.object_]:
    """
    Merge the faces of each building; None for one that has none, or is of several parts.

    Vertices that an outline had get back the coordinates they had there, the same in all buildings. Those
    that are not `kept` go where no wall bends or begins.
    """
    merged = np.array(
        [shapely.coverage_union_all(faces[owner == building]) for building in range(len(polygons))],
        dtype=object,
    )
    is_one = shapely.get_type_id(merged) == shapely.GeometryType.POLYGON
    is_one &= ~shapely.is_empty(merged)
    rings, ring_of = shapely.get_rings(merged[is_one], return_index=True)
    known = _known_places(polygons, grid)
    cells = [_cells(shapely.get_coordinates(ring)[:-1], grid) for ring in rings]
    dropped = _straight(cells, set(_cells(kept, grid)))
    result = np.full(len(polygons), None, dtype=object)
    parts: list[list[list[tuple[float, float]]]] = [[] for _ in range(is_one.sum())]
    for ring, building in zip(cells, ring_of, strict=True):
        ring = [cell for cell in ring if cell not in dropped]
        if len(ring) >= 3:
            parts[building].append([known.get(cell, (cell[0] * grid, cell[1] * grid)) for cell in ring])
    for building, own in zip(np.flatnonzero(is_one), parts, strict=True):
        result[building] = shapely.Polygon(own[0], own[1:]) if own else None
    return result


def _cells(places: NDArray[np.float64], grid: float) -> list[tuple[int, int]]:
    """Return the grid cells that places are the middle of, or nearest to."""
    return [(x, y) for x, y in np.rint(places / grid).astype(np.int64).tolist()]


def _known_places(polygons: NDArray[np.object_], grid: float) -> dict[tuple[int, int], tuple[float, float]]:
    """Return the coordinates of the outlines' vertices by cell; of several in a cell the least."""
    places = shapely.get_coordinates(polygons)
    places = places[np.lexsort(places.T[::-1])][::-1]
    return {cell: (x, y) for cell, (x, y) in zip(_cells(places, grid), places.tolist(), strict=True)}


def _straight(rings: list[list[tuple[int, int]]], kept: set[tuple[int, int]]) -> set[tuple[int, int]]:
    """Return the vertices, but for those kept, that lie between the same two on a line in all rings."""
    neighbours: dict[tuple[int, int], set[tuple[int, int]]] = {}
    for ring in rings:
        for before, cell, after in zip(ring[-1:] + ring[:-1], ring, ring[1:] + ring[:1], strict=True):
            neighbours.setdefault(cell, set()).update((before, after))
    straight: set[tuple[int, int]] = set()
    for cell in sorted(neighbours):
        if cell in kept or len(neighbours[cell]) != 2:
            continue
        first, second = sorted(neighbours[cell])
        (x, y), (u, v) = (first[0] - cell[0], first[1] - cell[1]), (second[0] - cell[0], second[1] - cell[1])
        bend = abs(x * v - y * u) / max(np.hypot(u - x, v - y), 1.0)
        if bend <= MAX_BEND and x * u + y * v < 0:
            straight.add(cell)
            neighbours[first] = neighbours[first] - {cell} | {second}
            neighbours[second] = neighbours[second] - {cell} | {first}
    return straight
