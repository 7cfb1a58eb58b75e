"""What can be wrong with single rings: too few points, repeated points, rings that meet themselves."""

from __future__ import annotations

import numpy as np
from numba import njit

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.solids.validity.codes import TOUCHING
from lidar_buildings.core.solids.validity.face_arrays import FaceArrays
from lidar_buildings.core.solids.validity.triangulation import turn


def repeated_points(faces: FaceArrays) -> set[int]:
    """Return 101 if a ring has fewer than three points, 102 if one follows upon itself."""
    return {int(code) for code in _repetitions(faces.corners, faces.ring_starts)} - {0}


def self_intersections(faces: FaceArrays, flat: FloatArray) -> set[int]:
    """Return 104 if a ring, seen in its face's plane, crosses or touches itself or has no area."""
    return {104} if _any_self_intersection(flat, faces.ring_starts) else set()


@njit(cache=True, nogil=True)
def _repetitions(corners: IntArray, ring_starts: IntArray) -> IntArray:
    codes = np.zeros(len(ring_starts) - 1, dtype=np.int64)
    for number in range(len(codes)):
        ring = corners[ring_starts[number] : ring_starts[number + 1]]
        if not _has_three(ring):
            codes[number] = 101
            continue
        for k in range(len(ring)):
            if ring[k] == ring[k - 1]:
                codes[number] = 102
    return codes


@njit(cache=True, nogil=True)
def _has_three(ring: IntArray) -> bool:
    second = 0
    while second < len(ring) and ring[second] == ring[0]:
        second += 1
    third = second + 1
    while third < len(ring) and (ring[third] == ring[0] or ring[third] == ring[second]):
        third += 1
    return third < len(ring)


@njit(cache=True, nogil=True)
def _any_self_intersection(flat: FloatArray, ring_starts: IntArray) -> bool:
    for number in range(len(ring_starts) - 1):
        if _meets_itself(flat[ring_starts[number] : ring_starts[number + 1]]):
            return True
    return False


@njit(cache=True, nogil=True)
def _meets_itself(ring: FloatArray) -> bool:
    """Whether a ring has no area, folds back at a corner, or has edges that meet away from common corners."""
    n = len(ring)
    doubled_area = 0.0
    length = 0.0
    for k in range(n):
        dx, dy = ring[k, 0] - ring[k - 1, 0], ring[k, 1] - ring[k - 1, 1]
        doubled_area += (ring[k - 1, 0] - ring[0, 0]) * dy - (ring[k - 1, 1] - ring[0, 1]) * dx
        length += np.sqrt(dx * dx + dy * dy)
    if abs(doubled_area) <= TOUCHING * length:
        return True
    for k in range(n):
        # A corner where the ring turns back upon its last edge.
        if near_segment(ring[k], ring[k - 2], ring[k - 1]) or near_segment(ring[k - 2], ring[k - 1], ring[k]):
            return True
        # The last edge is followed by the first.
        for j in range(1 if k == n - 1 else 0, k - 1):
            if segments_meet(ring[k - 1], ring[k], ring[j - 1], ring[j]):
                return True
    return False


@njit(cache=True, nogil=True)
def near_segment(p: FloatArray, a: FloatArray, b: FloatArray) -> bool:
    """Whether a point lies within `TOUCHING` of a segment."""
    ex, ey = b[0] - a[0], b[1] - a[1]
    px, py = p[0] - a[0], p[1] - a[1]
    squared = ex * ex + ey * ey
    share = 0.0 if squared == 0.0 else min(1.0, max(0.0, (px * ex + py * ey) / squared))
    dx, dy = px - share * ex, py - share * ey
    return dx * dx + dy * dy <= TOUCHING**2


@njit(cache=True, nogil=True)
def segments_meet(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> bool:
    """Whether two segments cross, or come within `TOUCHING` of each other."""
    for axis in range(2):
        if max(a[axis], b[axis]) + TOUCHING < min(c[axis], d[axis]):
            return False
        if max(c[axis], d[axis]) + TOUCHING < min(a[axis], b[axis]):
            return False
    if (turn(a, b, c) > 0.0) != (turn(a, b, d) > 0.0) and (turn(c, d, a) > 0.0) != (turn(c, d, b) > 0.0):
        return True
    return near_segment(a, c, d) or near_segment(b, c, d) or near_segment(c, a, b) or near_segment(d, a, b)
