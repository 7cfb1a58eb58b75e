"""Roof faces from labelled cells."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.few_rows import rows_by_group, sort_rows
from lidar_buildings.core.neighbours.union_find import flatten, link, numbered, sets_of_pairs
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
    return numbered(_parts(cells.vertices, cells.borders, cells.sides, face, planes, min_step))


@kernel
def _parts(vertices, borders, sides, face, planes, min_step):  # type: ignore[no-untyped-def]
    n, m = len(planes), 0
    keys, rows = np.empty(len(borders), np.int64), np.empty(len(borders), np.int64)
    for e in range(len(borders)):
        left = face[sides[e, 0]] if sides[e, 0] >= 0 else -1
        right = face[sides[e, 1]] if sides[e, 1] >= 0 else -1
        if left >= 0 and right >= 0 and left != right:
            keys[m], rows[m] = min(left, right) * n + max(left, right), e
            m += 1
    sort_rows(keys, rows, m)
    parent = np.arange(n)
    step, length = 0.0, 0.0
    for k in range(m):
        low, high = keys[k] // n, keys[k] % n
        a, b, c = planes[low] - planes[high]
        ax, ay = vertices[borders[rows[k], 0]]
        bx, by = vertices[borders[rows[k], 1]]
        first, last = a * ax + b * ay + c, a * bx + b * by + c
        mean = 0.5 * abs(first + last)
        if first * last < 0.0:
            # Where the planes cross on the way, the mean of two triangles.
            mean = 0.5 * (first**2 + last**2) / max(abs(first - last), 1e-12)
        step += math.hypot(bx - ax, by - ay) * mean
        length += math.hypot(bx - ax, by - ay)
        if k + 1 == m or keys[k + 1] != keys[k]:
            if step < min_step * length:
                link(parent, low, high)
            step, length = 0.0, 0.0
    flatten(parent)
    return parent


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
    ends = borders.reshape(-1)
    rows, first = rows_by_group(ends, len(vertices))
    near = ends[rows ^ 1]
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
