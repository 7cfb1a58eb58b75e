"""
Shells that cross or touch themselves: triangles that meet where they must not.

Exact tests on whole-number coordinates, after Guigue and Devillers (2003): the sides on which corners lie
decide everything. Triangles may have common vertices; they must not meet elsewhere.
"""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.solids.output_grid import GRID

#: Extent in units up to which six products of three differences fit in 64 bits.
_MAX_EXTENT = 1_100_000


def whole_numbers(vertices: FloatArray) -> IntArray:
    """Return coordinates in units: the output grid's for what lies on it, else the smallest that fits."""
    low = vertices.min(axis=0)
    extent = float(np.ptp(vertices, axis=0).max())
    on_grid = np.abs(vertices / GRID - np.rint(vertices / GRID)).max() < 1e-3
    if on_grid and extent / GRID <= _MAX_EXTENT:
        steps = np.rint(vertices / GRID)
        return (steps - steps.min(axis=0)).astype(np.int64)
    return np.rint((vertices - low) * (_MAX_EXTENT / max(extent, 1e-300))).astype(np.int64)


@kernel
def side_of_plane(p: IntArray, a: int, b: int, c: int, d: int) -> int:
    """Return the sign of the volume of a tetrahedron of rows: 0 if all lie in one plane."""
    ux, uy, uz = p[a, 0] - p[d, 0], p[a, 1] - p[d, 1], p[a, 2] - p[d, 2]
    vx, vy, vz = p[b, 0] - p[d, 0], p[b, 1] - p[d, 1], p[b, 2] - p[d, 2]
    wx, wy, wz = p[c, 0] - p[d, 0], p[c, 1] - p[d, 1], p[c, 2] - p[d, 2]
    return sign(ux * (vy * wz - vz * wy) + uy * (vz * wx - vx * wz) + uz * (vx * wy - vy * wx))


@kernel
def side_of_line(p: IntArray, a: int, b: int, c: int, dropped: int) -> int:
    """Return the sign of the area of a triangle of rows, seen along one axis."""
    i, j = (dropped + 1) % 3, (dropped + 2) % 3
    return sign((p[b, i] - p[a, i]) * (p[c, j] - p[a, j]) - (p[b, j] - p[a, j]) * (p[c, i] - p[a, i]))


@kernel
def steepest_axis(p: IntArray, a: int, b: int, c: int) -> int:
    """Return an axis along which a triangle of rows is seen with an area, −1 if it has none."""
    best, chosen = 0, -1
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        area = abs((p[b, i] - p[a, i]) * (p[c, j] - p[a, j]) - (p[b, j] - p[a, j]) * (p[c, i] - p[a, i]))
        if area > best:
            best, chosen = area, axis
    return chosen


@inner_kernel
def sign(value: int) -> int:
    """Return −1, 0 or 1."""
    if value > 0:
        return 1
    return -1 if value < 0 else 0


def self_intersects(vertices: FloatArray, triangles: IntArray, face_of: IntArray) -> bool:
    """
    Whether triangles of different faces meet elsewhere than in common vertices and edges: code 306.

    Boxes around the triangles are swept along the longest axis (Cohen et al. 1995); where two overlap, the
    triangles are tested exactly.
    """
    points = whole_numbers(vertices)
    sweep = int(np.argmax(np.ptp(points, axis=0)))
    points = np.ascontiguousarray(np.roll(points, -sweep, axis=1))
    corners = points[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    order = np.argsort(low[:, 0], kind="stable")
    return bool(_any_meet(points, triangles[order], face_of[order], low[order], high[order]))


@kernel
def _any_meet(points, triangles, face_of, low, high):  # type: ignore[no-untyped-def]
    """Sweep the boxes in the order of their lower ends and test those that overlap."""
    for i in range(len(triangles)):
        for j in range(i + 1, len(triangles)):
            if low[j, 0] > high[i, 0]:
                break
            if low[j, 1] > high[i, 1] or low[i, 1] > high[j, 1]:
                continue
            if low[j, 2] > high[i, 2] or low[i, 2] > high[j, 2] or face_of[i] == face_of[j]:
                continue
            if triangles_meet(points, triangles[i], triangles[j]):
                return True
    return False


@kernel
def triangles_meet(p: IntArray, s: IntArray, t: IntArray) -> bool:
    """Whether two triangles (three rows each) meet elsewhere than in their common vertices and edge."""
    common = 0
    alone_s, alone_t = 0, 0
    for i in range(3):
        shared = False
        for j in range(3):
            shared = shared or s[i] == t[j]
        if shared:
            common += 1
        else:
            alone_s = i
    for j in range(3):
        if t[j] != s[0] and t[j] != s[1] and t[j] != s[2]:
            alone_t = j
    if common == 3:
        return True
    if common == 2:
        return _folded_together(p, s, t, alone_s, alone_t)
    if common == 1:
        return _meet_beyond_vertex(p, s, t)
    return _meet_apart(p, s, t)


@inner_kernel
def _folded_together(p: IntArray, s: IntArray, t: IntArray, alone_s: int, alone_t: int) -> bool:
    """Whether two triangles with a common edge lie upon each other."""
    a, b, c, d = s[(alone_s + 1) % 3], s[(alone_s + 2) % 3], s[alone_s], t[alone_t]
    if side_of_plane(p, a, b, c, d) != 0:
        return False
    axis = steepest_axis(p, a, b, c)
    return axis < 0 or side_of_line(p, a, b, c, axis) == side_of_line(p, a, b, d, axis)


@kernel
def _meet_beyond_vertex(p: IntArray, s: IntArray, t: IntArray) -> bool:
    """Whether triangles with one common vertex meet elsewhere: an opposite side meets the other one."""
    for i in range(3):
        for j in range(3):
            if s[i] == t[j]:
                a, b, c, d = s[(i + 1) % 3], s[(i + 2) % 3], t[(j + 1) % 3], t[(j + 2) % 3]
                if side_of_plane(p, t[0], t[1], t[2], a) * side_of_plane(p, t[0], t[1], t[2], b) > 0:
                    return False
                return _segment_meets(p, a, b, t) or _segment_meets(p, c, d, s)
    return False


@kernel
def _meet_apart(p: IntArray, s: IntArray, t: IntArray) -> bool:
    if _beside(p, s, t) or _beside(p, t, s):
        return False
    for k in range(3):
        if _segment_meets(p, s[k], s[(k + 1) % 3], t) or _segment_meets(p, t[k], t[(k + 1) % 3], s):
            return True
    return False


@kernel
def _beside(p: IntArray, s: IntArray, t: IntArray) -> bool:
    first = side_of_plane(p, t[0], t[1], t[2], s[0])
    if first == 0 or side_of_plane(p, t[0], t[1], t[2], s[1]) != first:
        return False
    return side_of_plane(p, t[0], t[1], t[2], s[2]) == first


@kernel
def _segment_meets(p: IntArray, q: int, r: int, t: IntArray) -> bool:
    side_q = side_of_plane(p, t[0], t[1], t[2], q)
    side_r = side_of_plane(p, t[0], t[1], t[2], r)
    if side_q * side_r > 0:
        return False
    if side_q == 0 and side_r == 0:
        return _segment_meets_flat(p, q, r, t)
    if side_q == 0:
        return _point_in(p, q, t)
    if side_r == 0:
        return _point_in(p, r, t)
    first = side_of_plane(p, q, r, t[0], t[1])
    second = side_of_plane(p, q, r, t[1], t[2])
    third = side_of_plane(p, q, r, t[2], t[0])
    return (first >= 0 and second >= 0 and third >= 0) or (first <= 0 and second <= 0 and third <= 0)


@kernel
def _point_in(p: IntArray, q: int, t: IntArray) -> bool:
    """Whether a point in a triangle's plane lies in the triangle or on its border."""
    axis = steepest_axis(p, t[0], t[1], t[2])
    if axis < 0:
        return False
    first = side_of_line(p, t[0], t[1], q, axis)
    second = side_of_line(p, t[1], t[2], q, axis)
    third = side_of_line(p, t[2], t[0], q, axis)
    return (first >= 0 and second >= 0 and third >= 0) or (first <= 0 and second <= 0 and third <= 0)


@kernel
def _segment_meets_flat(p: IntArray, q: int, r: int, t: IntArray) -> bool:
    """Whether a segment in a triangle's plane has a point in common with the triangle."""
    if _point_in(p, q, t) or _point_in(p, r, t):
        return True
    axis = steepest_axis(p, t[0], t[1], t[2])
    if axis < 0:
        return False
    return (
        _segments_meet_flat(p, q, r, t[0], t[1], axis)
        or _segments_meet_flat(p, q, r, t[1], t[2], axis)
        or _segments_meet_flat(p, q, r, t[2], t[0], axis)
    )


@kernel
def _segments_meet_flat(p: IntArray, q: int, r: int, a: int, b: int, axis: int) -> bool:
    """Whether segments qr and ab, seen along an axis, have a point in common; q and r do not lie on ab."""
    side_a, side_b = side_of_line(p, q, r, a, axis), side_of_line(p, q, r, b, axis)
    if side_a == 0 and side_b == 0:
        return _between(p, q, r, a)
    return side_a * side_b <= 0 and side_of_line(p, a, b, q, axis) * side_of_line(p, a, b, r, axis) <= 0


@kernel
def _between(p: IntArray, q: int, r: int, a: int) -> bool:
    for axis in range(3):
        if p[a, axis] < min(p[q, axis], p[r, axis]) or p[a, axis] > max(p[q, axis], p[r, axis]):
            return False
    return True
