"""
Planar subdivisions: the faces into which lines divide the plane, who owns each, and their edges.

Outlines of a block that share walls, the cells of a roof, and the pieces of a roof that do not match are
divided here. Vertices lie on a grid, so that equal places are equal numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import IntArray
from lidar_buildings.core.neighbours.few_rows import rows_by_group

#: Stands for what lies in no polygon.
OUTSIDE = -1

#: Of pairs of a face and a polygon, and the faces' inner points: keys by which the least pair is preferred.
Preference = Callable[[IntArray, IntArray, NDArray[np.object_]], Sequence[NDArray[Any]]]


def divide_plane(lines: NDArray[np.object_], grid: float) -> NDArray[np.object_]:
    """
    Return the faces into which lines divide the plane, their vertices on multiples of `grid`.

    Lines are noded by snap rounding (Hobby, 1999): edges nearer to a vertex than half a step run through it.
    """
    noded = shapely.union_all(lines, grid_size=grid)
    return np.asarray(shapely.get_parts(shapely.polygonize([noded])))


def face_owners(
    faces: NDArray[np.object_], polygons: NDArray[np.object_], prefer: Preference | None = None
) -> IntArray:
    """Return which polygon each face lies in, of several the first, or the preferred one, else OUTSIDE."""
    inside = shapely.point_on_surface(faces)
    face, polygon = shapely.STRtree(polygons).query(inside, predicate="intersects")
    keys = () if prefer is None else prefer(face, polygon, inside)
    order = np.lexsort((polygon, *reversed(keys), face))
    face, polygon = face[order], polygon[order]
    first = np.flatnonzero(np.diff(face, prepend=-1))
    owners = np.full(len(faces), OUTSIDE)
    owners[face[first]] = polygon[first]
    return owners


class PlanGraph(NamedTuple):
    """The edges of a coverage."""

    places: IntArray  #: by x, then y [steps of the grid], shape (n_vertices, 2)
    ends: IntArray  #: rows of the places, the lower first; edges rise, shape (n_edges, 2)
    #: Number of the owner to the left of each edge and to its right, OUTSIDE for none, shape (n_edges, 2).
    sides: IntArray


def graph_of(polygons: NDArray[np.object_], owner: IntArray) -> PlanGraph | None:
    """
    Return the graph of valid polygons [steps of the grid]; None if two claim the same side of an edge.

    Edges between polygons of the same owner are left out.
    """
    lines, polygon = shapely.get_rings(shapely.normalize(polygons), return_index=True)
    corners, ring = shapely.get_coordinates(lines, return_index=True)
    corners = np.rint(corners).astype(np.int64)
    if not len(corners):
        return PlanGraph(corners, corners, corners)
    low, (_, height) = corners.min(axis=0), np.ptp(corners, axis=0) + 1
    keys, place = np.unique((corners - low) @ [height, 1], return_inverse=True)
    places = low + np.column_stack(np.divmod(keys, height))
    goes_on = (ring[1:] == ring[:-1]) & (place[1:] != place[:-1])
    start, end = place[:-1][goes_on], place[1:][goes_on]
    # Polygons lie to the right of their normalised rings.
    side = (start < end).astype(np.int64)
    keys, edge = np.unique(np.minimum(start, end) * len(places) + np.maximum(start, end), return_inverse=True)
    if (np.bincount(2 * edge + side) > 1).any():
        return None
    sides = np.full((len(keys), 2), OUTSIDE)
    sides[edge, side] = owner[polygon[ring[:-1][goes_on]]]
    parted = sides[:, 0] != sides[:, 1]
    ends = np.column_stack(np.divmod(keys[parted], len(places)))
    return PlanGraph(places, ends, sides[parted])


def straightened_rings(
    polygons: NDArray[np.object_], kept: IntArray, max_bend: float
) -> list[list[IntArray]]:
    """
    Return the rings of polygons that share whole edges, without vertices at which no ring bends.

    Vertices that lie between the same two in all rings, no farther than `max_bend` from the line through
    them, go, but for the places `kept`, shape (n, 2) [steps of the grid]. Each polygon has its exterior
    first; rings are open, rings of fewer than three vertices are left out.
    """
    lines, polygon = shapely.get_rings(polygons, return_index=True)
    corners, ring = shapely.get_coordinates(lines, return_index=True)
    is_end = np.diff(ring, append=len(lines)) != 0
    corners = np.rint(corners).astype(np.int64)
    places, row = np.unique(np.concatenate([corners, kept]), axis=0, return_inverse=True)
    row = row.reshape(-1)
    stays = np.zeros(len(places), dtype=np.bool_)
    stays[row[len(corners) :]] = True
    row = row[: len(corners)]
    edges = np.column_stack([row[:-1], row[1:]])[~is_end[:-1]]
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    is_left = ~straight_places(places, edges, stays, max_bend)[row] & ~is_end
    result: list[list[IntArray]] = [[] for _ in polygons]
    parts = np.split(corners[is_left], np.cumsum(np.bincount(ring[is_left], minlength=len(lines)))[:-1])
    for own, part in zip(polygon.tolist(), parts, strict=True):
        if len(part) >= 3:
            result[own].append(part)
    return result


@kernel
def straight_places(places, edges, stays, max_bend):  # type: ignore[no-untyped-def]
    """
    Say which places between two others go, as no edge bends there: one after the other, as they are sorted.

    A place goes that is no farther than `max_bend` from the line through those that are left beside it, if it
    is not one that stays; edges are rows of two places, (n_edges, 2).
    """
    ends = edges.reshape(-1)
    rows, first = rows_by_group(ends, len(places))
    near, goes = ends[rows ^ 1], np.zeros(len(places), np.bool_)
    for here in range(len(places)):
        if first[here + 1] - first[here] != 2 or stays[here]:
            continue
        one, other = near[first[here]], near[first[here] + 1]
        x, y = places[one, 0] - places[here, 0], places[one, 1] - places[here, 1]
        u, v = places[other, 0] - places[here, 0], places[other, 1] - places[here, 1]
        if one == other or x * u + y * v >= 0 or abs(x * v - y * u) > max_bend * np.hypot(u - x, v - y):
            continue
        goes[here] = True
        for v, beyond in ((one, other), (other, one)):
            for k in range(first[v], first[v + 1]):
                if near[k] == here:
                    near[k] = beyond
    return goes
