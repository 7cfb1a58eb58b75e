"""Roof faces from labelled cells."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.core.stages.building_model.arrangement import Cells

#: A vertex nearer to the line through its neighbours than this is no corner [m].
_STRAIGHT = 0.004


def join_equal_cells(cells: Cells, labels: IntArray) -> IntArray:
    """Number the connected groups of cells of one plane, from 0 in the order of their first cells."""
    same = labels[cells.edges[:, 0]] == labels[cells.edges[:, 1]]
    roots = sets_of_pairs(len(labels), *cells.edges[same].T)
    return np.unique(roots, return_inverse=True)[1].reshape(-1)


def absorb_small_faces(cells: Cells, labels: IntArray, min_area: float) -> IntArray:
    """
    Give faces smaller than `min_area` [m²] the plane beyond their longest border, the smallest one first.
    """
    labels = labels.copy()
    areas = shapely.area(cells.polygons)
    while True:
        face = join_equal_cells(cells, labels)
        size = np.bincount(face, areas)
        if len(size) < 2 or size.min() >= min_area:
            return labels
        small = int(np.argmin(size))
        borders = face[cells.edges]
        mine = (borders == small).any(axis=1) & (borders[:, 0] != borders[:, 1])
        if not mine.any():
            return labels
        other = np.where(borders[mine, 0] == small, borders[mine, 1], borders[mine, 0])
        longest = int(np.argmax(np.bincount(other, cells.lengths[mine])))
        labels[face == small] = labels[int(np.argmax(face == longest))]


def face_polygons(cells: Cells, face: IntArray) -> list[shapely.Polygon]:
    """Return the faces' polygons by number, whole edges shared as those of the cells are."""
    order = np.argsort(face, kind="stable")
    starts = np.flatnonzero(np.diff(face[order], prepend=-1))
    groups = np.split(cells.polygons[order], starts[1:])
    return [group[0] if len(group) == 1 else _united(group) for group in groups]


def _united(group: NDArray[np.object_]) -> shapely.Polygon:
    united = shapely.coverage_union_all(group)
    return united if united.geom_type == "Polygon" else max(shapely.get_parts(united), key=shapely.area)


def without_straight_vertices(
    polygons: list[shapely.Polygon], corners: FloatArray
) -> list[tuple[FloatArray, ...]]:
    """
    Return the rings of polygons that share whole edges, without vertices in the middle of straight edges.

    Parameters
    ----------
    polygons : list of shapely.Polygon
        A coverage.
    corners : ndarray of shape (n_corners, 2)
        Vertices to keep whatever lies around them: those of the outline [m].

    Returns
    -------
    list of tuple of ndarray of shape (n_vertices, 2)
        Per polygon its outer ring counter-clockwise, then its holes clockwise, open; none for a polygon
        without corners.
    """
    rings = [
        [[tuple(xy) for xy in np.asarray(ring.coords)[:-1].tolist()] for ring in (p.exterior, *p.interiors)]
        for p in (shapely.geometry.polygon.orient(polygon) for polygon in polygons)
    ]
    neighbours: dict[tuple[float, float], set[tuple[float, float]]] = {}
    for ring in (ring for group in rings for ring in group):
        for before, here, after in zip(ring[-1:] + ring[:-1], ring, ring[1:] + ring[:1], strict=True):
            neighbours.setdefault(here, set()).update((before, after))
    keep = set(map(tuple, corners.tolist()))
    dropped = _straight(neighbours, keep)
    kept = [[[xy for xy in ring if xy not in dropped] for ring in group] for group in rings]
    # A ring thinner than what counts as straight has no corners left: the solid closes such gaps.
    whole = [[ring for ring in group if len(ring) >= 3] if len(group[0]) >= 3 else [] for group in kept]
    return [tuple(np.array(ring) for ring in group) for group in whole]


def _straight(
    neighbours: dict[tuple[float, float], set[tuple[float, float]]], keep: set[tuple[float, float]]
) -> set[tuple[float, float]]:
    """Return the vertices to leave out; `neighbours` is used up."""
    dropped: set[tuple[float, float]] = set()
    for here in sorted(neighbours):
        around = neighbours[here]
        if len(around) != 2 or here in keep:
            continue
        one, other = around
        if other in neighbours[one]:
            continue
        dx, dy = other[0] - one[0], other[1] - one[1]
        off = abs(dx * (here[1] - one[1]) - dy * (here[0] - one[0]))
        if off <= _STRAIGHT * np.hypot(dx, dy):
            dropped.add(here)
            neighbours[one] = (neighbours[one] - {here}) | {other}
            neighbours[other] = (neighbours[other] - {here}) | {one}
    return dropped
