"""Roof faces from labelled cells."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.union_find import numbered, sets_of_pairs
from lidar_buildings.core.stages.building_model.arrangement import Cells

#: A vertex nearer to the line through its neighbours than this is no corner [m].
_STRAIGHT = 0.004


def join_equal_cells(cells: Cells, labels: IntArray) -> IntArray:
    """Number the connected groups of cells of one plane, from 0 in the order of their first cells."""
    left, right = cells.sides[(cells.sides[:, 0] >= 0) & (cells.sides[:, 1] >= 0)].T
    same = labels[left] == labels[right]
    return numbered(sets_of_pairs(len(labels), left[same], right[same]))


def parts_of_one_height(cells: Cells, face: IntArray, planes: FloatArray, min_step: float) -> IntArray:
    """
    Number the parts of a roof, from 0: faces that meet, or are parted by a low step only, belong together.

    Two parts are parted by a mean step of `min_step` [m] along their common border.
    """
    if len(planes) < 2:
        return np.zeros(len(planes), dtype=np.int64)
    left, right = np.append(face, -1)[cells.sides.T]
    low, high = np.minimum(left, right), np.maximum(left, right)
    between = ((low >= 0) & (low < high)).nonzero()[0]
    low, high = low[between], high[between]
    (ax, ay), (bx, by) = cells.vertices[cells.borders[between]].transpose(1, 2, 0)
    length = np.hypot(bx - ax, by - ay)
    a, b, c = (planes[low] - planes[high]).T
    first, last = a * ax + b * ay + c, a * bx + b * by + c
    # Where the planes cross on the way, the mean of two triangles.
    crossed = (first**2 + last**2) / np.maximum(np.abs(first - last), 1e-12)
    mean = 0.5 * np.where(first * last < 0.0, crossed, np.abs(first + last))
    pair, inverse = np.unique(low * len(planes) + high, return_inverse=True)
    is_low = np.bincount(inverse, length * mean) < min_step * np.bincount(inverse, length)
    return numbered(sets_of_pairs(len(planes), *np.divmod(pair[is_low], len(planes))))


def face_rings(cells: Cells, face: IntArray) -> list[tuple[FloatArray, ...]]:
    """
    Return the rings of faces, without vertices in the middle of straight edges.

    The outline keeps its own vertices, whatever lies around them. A face has its outer ring
    counter-clockwise, then its holes clockwise, open; none if it has no corners: the solid closes such gaps.
    """
    sides = np.append(face, -1)[cells.sides]
    borders = cells.borders[sides[:, 0] != sides[:, 1]]
    kept = np.ones(len(cells.vertices), dtype=np.bool_)
    fixed = np.zeros(len(cells.vertices), dtype=np.bool_)
    fixed[cells.corners] = True
    _drop_straight(cells.vertices, borders, fixed, kept)
    return cells.rings_of(face, kept)


@kernel
def _drop_straight(vertices, borders, fixed, kept):  # type: ignore[no-untyped-def]
    """Clear `kept` of the vertices to leave out, one after the other by rising x, then y."""
    first = np.zeros(len(vertices) + 1, np.int64)
    near = np.empty(2 * len(borders), np.int64)
    for e in range(len(borders)):
        first[borders[e, 0]] += 1
        first[borders[e, 1]] += 1
    for v in range(len(vertices)):
        first[v + 1] += first[v]
    for e in range(len(borders)):
        for end in range(2):
            first[borders[e, end]] -= 1
            near[first[borders[e, end]]] = borders[e, 1 - end]
    for here in range(len(vertices)):
        at = first[here]
        if first[here + 1] - at != 2 or fixed[here]:
            continue
        one, other = near[at], near[at + 1]
        meet = False
        for k in range(first[one], first[one + 1]):
            meet |= near[k] == other
        if meet:
            continue
        dx, dy = vertices[other, 0] - vertices[one, 0], vertices[other, 1] - vertices[one, 1]
        off = dx * (vertices[here, 1] - vertices[one, 1]) - dy * (vertices[here, 0] - vertices[one, 0])
        if abs(off) <= _STRAIGHT * np.hypot(dx, dy):
            kept[here] = False
            for v, beyond in ((one, other), (other, one)):
                for k in range(first[v], first[v + 1]):
                    if near[k] == here:
                        near[k] = beyond
