"""
Faces cut into triangles: ears first, then flipped until every edge is as Delaunay wants it.

Holes are joined to the exterior by bridges (Eberly 2002), ears are cut off best first (Meisters 1975), and
diagonals are flipped (Lawson 1977), which gives the constrained Delaunay triangulation of the face.

Written out, not `shapely.constrained_delaunay_triangles`: with that 1500 solids of `bench.models.solids` took
6.4 s in place of 5.0, 55 of them came out in other triangles, and Ubuntu 24.04's shapely has none.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.solids.validity.face_arrays import FaceArrays
from lidar_buildings.core.solids.validity.flips import flip_to_delaunay

#: A corner whose ear is lower than this is straight [m].
_STRAIGHT = 1e-9
#: Rings with more corners than this get the first ear found, not the best.
_MANY = 24


def triangulate(faces: FaceArrays, flat: FloatArray) -> tuple[IntArray, IntArray]:
    """
    Return the triangles of all faces, counter-clockwise seen from outside.

    Returns
    -------
    triangles : ndarray of shape (n_triangles, 3)
        Rows of the vertices.
    face_of : ndarray of shape (n_triangles,)
        The face of each triangle.
    """
    n_holes = np.diff(faces.face_starts) - 1
    counts = np.diff(faces.corner_starts) - 2 + 2 * n_holes
    starts = np.concatenate(([0], np.cumsum(counts)))
    triangles = np.empty((starts[-1], 3), dtype=np.int64)
    _triangulate_all(flat, faces.corners, faces.ring_starts, faces.face_starts, starts, triangles)
    used = triangles[:, 0] >= 0
    return triangles[used], np.repeat(np.arange(len(counts)), counts)[used]


@njit(cache=True, nogil=True)
def _triangulate_all(
    flat: FloatArray,
    corners: IntArray,
    ring_starts: IntArray,
    face_starts: IntArray,
    starts: IntArray,
    triangles: IntArray,
) -> None:
    """Triangulate face by face into the rows reserved for each."""
    for face in range(len(face_starts) - 1):
        rings = ring_starts[face_starts[face] : face_starts[face + 1] + 1]
        rows = triangles[starts[face] : starts[face + 1]]
        if len(rings) == 2 and rings[1] - rings[0] == 3:
            for k in range(3):
                rows[0, k] = corners[rings[0] + k]
            continue
        loop = _joined_rings(flat, corners, rings)
        # A hole that touches another ring needs no bridge: two triangles fewer.
        rows[len(loop) - 2 :] = -1
        rows = rows[: len(loop) - 2]
        _cut_ears(flat, loop, rows)
        flip_to_delaunay(flat, corners, rows)
        for row in rows:
            for k in range(3):
                row[k] = corners[row[k]]


@njit(cache=True, nogil=True)
def _joined_rings(flat: FloatArray, corners: IntArray, rings: IntArray) -> IntArray:
    """
    Return one closed loop of corners that runs along all rings of a face, with bridges to the holes.

    The rightmost of the holes that are left is the next one: it can be seen from what it is joined to.
    """
    n_holes = len(rings) - 2
    loop = np.empty(rings[-1] - rings[0] + 2 * n_holes, dtype=np.int64)
    n = rings[1] - rings[0]
    for k in range(n):
        loop[k] = rings[0] + k
    joined = np.zeros(n_holes, dtype=np.bool_)
    for _ in range(n_holes):
        best, chosen = -np.inf, 0
        for hole in range(n_holes):
            for corner in range(rings[hole + 1], rings[hole + 2]):
                if not joined[hole] and flat[corner, 0] > best:
                    best, chosen = flat[corner, 0], hole
        joined[chosen] = True
        n = _join_hole(flat, corners, loop, n, rings, chosen + 1)
    return loop[:n]


@njit(cache=True, nogil=True)
def _join_hole(
    flat: FloatArray, corners: IntArray, loop: IntArray, n: int, rings: IntArray, number: int
) -> int:
    """
    Join a hole to the first n corners of a loop and return how many it has then.

    At a common vertex if there is one, else by the shortest bridge in sight.
    """
    first, size = rings[number], rings[number + 1] - rings[number]
    rightmost = 0
    for j in range(size):
        if flat[first + j, 0] > flat[first + rightmost, 0]:
            rightmost = j
    best, at, entry = _bridge(flat, corners, loop[:n], rings, number, rightmost)
    if at < 0:
        best, at, entry = _bridge(flat, corners, loop[:n], rings, number, -1)
    at = max(at, 0)
    added = size if best < 0.0 else size + 2
    for k in range(n - 1, at, -1):
        loop[k + added] = loop[k]
    for k in range(added):
        # Once around the hole from the entry on, and, over a bridge, back to where it began.
        loop[at + 1 + k] = first + (entry + k + (1 if best < 0.0 else 0)) % size
    if best >= 0.0:
        loop[at + added] = loop[at]
    return n + added


@njit(cache=True, nogil=True)
def _bridge(
    flat: FloatArray, corners: IntArray, loop: IntArray, rings: IntArray, number: int, only: int
) -> tuple[float, int, int]:
    """
    Return the squared length of the shortest bridge, −1 where none is needed, and its ends in loop and hole.

    Bridges from one corner of the hole only are looked at, or, if it is −1, from all. Without any the end in
    the loop is −1.
    """
    first, size = rings[number], rings[number + 1] - rings[number]
    best = np.inf
    at, entry = -1, 0
    for i in range(len(loop)):
        for j in range(size):
            touches = corners[loop[i]] == corners[first + j]
            if not touches and only >= 0 and j != only:
                continue
            gap = -1.0 if touches else _squared(flat[loop[i]], flat[first + j])
            if gap >= best:
                continue
            ahead = first + ((j + 1) % size if touches else j)
            if _in_cone(flat, loop, i, flat[ahead]) and (
                touches or _in_sight(flat, loop, rings, loop[i], first + j)
            ):
                best, at, entry = gap, i, j
    return best, at, entry


@njit(cache=True, nogil=True)
def _in_cone(flat: FloatArray, loop: IntArray, i: int, p: FloatArray) -> bool:
    """Whether a point is seen from a corner of a loop in the direction of its inside."""
    before, here, after = flat[loop[i - 1]], flat[loop[i]], flat[loop[(i + 1) % len(loop)]]
    left_of_in, left_of_out = turn(before, here, p) > 0.0, turn(here, after, p) > 0.0
    if turn(before, here, after) > 0.0:
        return left_of_in and left_of_out
    return left_of_in or left_of_out


@njit(cache=True, nogil=True)
def _in_sight(flat: FloatArray, loop: IntArray, rings: IntArray, start: int, end: int) -> bool:
    """Whether no edge of a loop or of the face's rings lies between two corners."""
    for k in range(len(loop)):
        if _separates(flat[start], flat[end], flat[loop[k - 1]], flat[loop[k]]):
            return False
    for number in range(1, len(rings) - 1):
        before = rings[number + 1] - 1
        for here in range(rings[number], rings[number + 1]):
            if _separates(flat[start], flat[end], flat[before], flat[here]):
                return False
            before = here
    return True


@njit(cache=True, nogil=True)
def _separates(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> bool:
    """Whether segment cd meets segment ab elsewhere than in a common end."""
    if _squared(a, c) == 0.0 or _squared(a, d) == 0.0 or _squared(b, c) == 0.0 or _squared(b, d) == 0.0:
        return False
    return turn(a, b, c) * turn(a, b, d) <= 0.0 and turn(c, d, a) * turn(c, d, b) <= 0.0


@njit(cache=True, nogil=True)
def _cut_ears(flat: FloatArray, loop: IntArray, rows: IntArray) -> None:
    left = loop.copy()
    n = len(left)
    count = 0
    start = 0
    while n > 3:
        k = _next_ear(flat, left[:n], start)
        rows[count, 0], rows[count, 1], rows[count, 2] = (
            left[k - 1 if k else n - 1],
            left[k],
            left[(k + 1) % n],
        )
        count += 1
        for j in range(k, n - 1):
            left[j] = left[j + 1]
        n -= 1
        start = k % n
    for k in range(3):
        rows[count, k] = left[k]


@njit(cache=True, nogil=True)
def _next_ear(flat: FloatArray, loop: IntArray, start: int) -> int:
    """
    Return the corner with the best ear, in long loops the first good one; a straight corner if there is none.
    """
    n = len(loop)
    best, chosen = -np.inf, start
    for step in range(n):
        k = (start + step) % n
        quality = _ear_quality(flat, loop, k)
        if quality > best:
            best, chosen = quality, k
            if n > _MANY and quality > 0.1:
                break
    return chosen


@njit(cache=True, nogil=True)
def _ear_quality(flat: FloatArray, loop: IntArray, k: int) -> float:
    """
    Return an ear's height over its longest side as a share of that side; −1 for straight, −2 for no ear.
    """
    n = len(loop)
    a, b, c = flat[loop[k - 1]], flat[loop[k]], flat[loop[(k + 1) % n]]
    longest = np.sqrt(max(_squared(a, b), _squared(b, c), _squared(c, a)))
    if longest == 0.0:
        return -1.0
    height = turn(a, b, c) / longest
    if height < -_STRAIGHT:
        return -3.0
    for j in range(n):
        p = flat[loop[j]]
        if _squared(p, a) == 0.0 or _squared(p, b) == 0.0 or _squared(p, c) == 0.0:
            continue
        if turn(a, b, p) >= 0.0 and turn(b, c, p) >= 0.0 and turn(c, a, p) >= 0.0:
            return -2.0
    return height / longest if height > _STRAIGHT else -1.0


@njit(cache=True, nogil=True)
def turn(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    """Return twice the area of a triangle, positive if counter-clockwise."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


@njit(cache=True, nogil=True)
def _squared(a: FloatArray, b: FloatArray) -> float:
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2
