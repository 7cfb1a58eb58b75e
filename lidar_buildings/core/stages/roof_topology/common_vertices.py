"""
Positions where planes should meet: outline corners that lines pass, and points that four or more planes pass.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.core.stages.roof_topology.pieces import Pieces, intersection_lines
from lidar_buildings.core.surfaces.roof_planes import CommonVertex, common_point

#: A line passes through a corner if no farther off it and ending no farther from it, in spacings.
_BESIDE_CORNER, _BEFORE_CORNER = 1.0, 2.0
#: Ends of lines within so many spacings of one another, directly or by way of others, may be one point.
_SAME_POINT = 3.0
#: Planes miss their common point by no more than this, root mean square [m].
_MOST_MISS = 0.08
#: Further planes whose lines end within so many spacings of a common point may pass it, too.
POINT_REACH = 8.0
#: Three planes meet in a point anyway.
_LEAST_PLANES = 4


def piece_ends(pieces: Pieces, gradients: FloatArray) -> FloatArray:
    """Return both ends of every piece in plan about the centre, shape (n_pieces, 2, 2) [m]."""
    lines = intersection_lines(pieces.first, pieces.second, gradients)
    return lines[:, None, :2] + pieces.t[:, :, None] * lines[:, None, 2:4]


def find_common_vertices(
    pieces: Pieces, gradients: FloatArray, centre: FloatArray, walls: FloatArray, spacing: float
) -> list[CommonVertex]:
    """
    Collect the common vertices that lines hint at; the adjustment finds out which of them the points allow.

    Planes and walls, the outline's edges, are about the centre.
    """
    if not len(pieces.pair):
        return []
    ends = piece_ends(pieces, gradients)
    vertices = _common_points(pieces, ends, gradients, centre, spacing)
    if len(walls):
        vertices += _corners(pieces, ends, walls[:, 0], centre, spacing)
    return vertices


def _corners(
    pieces: Pieces, ends: FloatArray, corners: FloatArray, centre: FloatArray, spacing: float
) -> list[CommonVertex]:
    """Pair the ends of lines with the outline's corners that they nearly pass through."""
    near = _near_corners(ends, corners, spacing)
    pairs = zip(pieces.first.tolist(), pieces.second.tolist(), near.tolist(), strict=True)
    places = (corners + centre[:2]).tolist()
    vertices = [
        CommonVertex((first, second), (places[at][0], places[at][1]), True)
        for first, second, rows in pairs
        for at in rows
        if at >= 0
    ]
    return list(dict.fromkeys(vertices))


@kernel
def _near_corners(ends, corners, spacing):  # type: ignore[no-untyped-def]
    """Return the row of the corner that each line nearly passes through at either end, -1 for none."""
    near = np.full((len(ends), 2), -1)
    for k in range(len(ends)):
        x, y = ends[k, 1, 0] - ends[k, 0, 0], ends[k, 1, 1] - ends[k, 0, 1]
        length = max(math.hypot(x, y), 1e-12)
        for end in range(2):
            least = _BEFORE_CORNER * spacing
            for i in range(len(corners)):
                u, v = corners[i, 0] - ends[k, end, 0], corners[i, 1] - ends[k, end, 1]
                distance, beside = math.hypot(u, v), abs(u * y - v * x) / length
                is_nearer = distance < least or (distance == least and near[k, end] < 0)
                if is_nearer and beside <= _BESIDE_CORNER * spacing:
                    near[k, end], least = i, distance
    return near


def _common_points(
    pieces: Pieces, ends: FloatArray, gradients: FloatArray, centre: FloatArray, spacing: float
) -> list[CommonVertex]:
    """Find where the ends of lines between four or more planes come together."""
    if len({*pieces.first.tolist(), *pieces.second.tolist()}) < _LEAST_PLANES:
        return []
    positions = ends.reshape(-1, 2)
    tree = cKDTree(positions, balanced_tree=False, compact_nodes=False)
    near = tree.query_pairs(_SAME_POINT * spacing, output_type="ndarray")
    cluster = sets_of_pairs(len(positions), *near.T).tolist()
    pairs = np.repeat(np.column_stack([pieces.first, pieces.second]), 2, axis=0)
    members: dict[int, list[int]] = {number: [] for number in cluster}
    for row, number in enumerate(cluster):
        members[number].append(row)
    vertices = []
    for number in sorted(members):
        mine = members[number]
        if 2 * len(mine) < _LEAST_PLANES or len(met := _planes_of(pairs[mine])) < _LEAST_PLANES:
            continue
        agreed = sorted(met)
        point, miss = common_point(gradients[np.array(agreed) - 1])
        apart = np.hypot(*(positions[mine] - point[:2]).T).min()
        if miss <= _MOST_MISS and apart <= _SAME_POINT * spacing:
            near = np.hypot(*(positions - point[:2]).T) <= POINT_REACH * spacing
            others = np.array(sorted(_planes_of(pairs[near]).difference(agreed)), dtype=np.int64)
            miss = gradients[others - 1, :2] @ point[:2] + gradients[others - 1, 2] - point[2]
            agreed += others[np.abs(miss) <= _MOST_MISS].tolist()
            x, y = point[:2] + centre[:2]
            vertices.append(CommonVertex(tuple(sorted(agreed)), (float(x), float(y)), False))
    return vertices


def _planes_of(pairs: NDArray[np.int32]) -> set[int]:
    return set(pairs.ravel().tolist())
