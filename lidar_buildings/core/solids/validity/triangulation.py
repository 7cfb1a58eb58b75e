"""
Faces cut into triangles: ears first, then flipped until every edge is as Delaunay wants it.

Holes are joined to the exterior by bridges (Eberly 2002), ears are cut off best first (Meisters 1975), and
diagonals are flipped (Lawson 1977), which gives the constrained Delaunay triangulation of the face.

Written out, not `shapely.constrained_delaunay_triangles`: with that 1500 solids of `bench.models.solids` took
6.4 s in place of 5.0, 55 of them came out in other triangles, and Ubuntu 24.04's shapely has none.
"""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.solids.validity.face_arrays import FaceArrays
from lidar_buildings.core.solids.validity.flips import flip_to_delaunay

#: A corner whose ear is lower than this is straight [m].
_STRAIGHT = 1e-9
#: Rings with more corners than this get the first ear found, not the best.
_MANY = 24
#: Qualities of an ear that has a corner inside, and of one that has to be looked at.
_BLOCKED, _UNKNOWN = -2.0, -9.0


def triangulate(faces: FaceArrays, flat: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the triangles of all faces, counter-clockwise seen from outside, and the face of each."""
    n_holes = np.diff(faces.face_starts) - 1
    counts = np.diff(faces.corner_starts) - 2 + 2 * n_holes
    starts = np.concatenate(([0], np.cumsum(counts)))
    triangles = np.empty((starts[-1], 3), dtype=np.int64)
    _triangulate_all(flat, faces.corners, faces.ring_starts, faces.face_starts, starts, triangles)
    used = triangles[:, 0] >= 0
    return triangles[used], np.repeat(np.arange(len(counts)), counts)[used]


@kernel
def _triangulate_all(
    flat: FloatArray,
    corners: IntArray,
    ring_starts: IntArray,
    face_starts: IntArray,
    starts: IntArray,
    triangles: IntArray,
) -> None:
    """Triangulate face by face into the rows reserved for each."""
    most = 0
    for face in range(len(face_starts) - 1):
        most = max(most, starts[face + 1] - starts[face] + 2)
    loop, quality = np.empty(most, dtype=np.int64), np.empty(most)
    across = np.empty((most, 3), dtype=np.int64)
    for face in range(len(face_starts) - 1):
        first_ring, last_ring = face_starts[face], face_starts[face + 1]
        row, begin = starts[face], ring_starts[first_ring]
        n = ring_starts[first_ring + 1] - begin
        for k in range(n):
            loop[k] = begin + k
        if last_ring - first_ring > 1:
            n = _join_holes(flat, corners, ring_starts, first_ring, last_ring, loop, n)
        # A hole that touches another ring needs no bridge: two triangles fewer.
        for k in range(row + n - 2, starts[face + 1]):
            triangles[k, 0] = -1
        _cut_ears(flat, loop, n, quality, triangles, row)
        if n > 3:
            flip_to_delaunay(flat, corners, triangles, row, row + n - 2, across)
        for t in range(row, row + n - 2):
            for k in range(3):
                triangles[t, k] = corners[triangles[t, k]]


@kernel
def _join_holes(
    flat: FloatArray,
    corners: IntArray,
    ring_starts: IntArray,
    first_ring: int,
    last_ring: int,
    loop: IntArray,
    n: int,
) -> int:
    """
    Join a face's holes to the first n corners of a loop, its exterior, and return how many it has then.

    The rightmost of the holes that are left is the next one: it can be seen from what it is joined to. It is
    joined at a common vertex if there is one, else by the shortest bridge in sight from its rightmost corner,
    and if that has none, from any.
    """
    joined = np.zeros(last_ring, dtype=np.bool_)
    for _ in range(first_ring + 1, last_ring):
        rightmost, chosen, tip = -np.inf, first_ring + 1, 0
        for ring in range(first_ring + 1, last_ring):
            for corner in range(ring_starts[ring], ring_starts[ring + 1]):
                if not joined[ring] and flat[corner, 0] > rightmost:
                    rightmost, chosen, tip = flat[corner, 0], ring, corner
        joined[chosen] = True
        first, last = ring_starts[chosen], ring_starts[chosen + 1]
        shortest, at, entry, touches = np.inf, -1, first, False
        for attempt in range(2):
            for i in range(n):
                for j in range(first, last):
                    meets = corners[loop[i]] == corners[j]
                    if not meets and attempt == 0 and j != tip:
                        continue
                    gap = -1.0 if meets else _squared(flat, loop[i], j)
                    if gap >= shortest:
                        continue
                    ahead = (j + 1 if j + 1 < last else first) if meets else j
                    if _is_free(flat, ring_starts, first_ring, last_ring, loop, n, i, ahead, meets):
                        shortest, at, entry, touches = gap, i, j, meets
            if at >= 0:
                break
        at = max(at, 0)
        added = last - first + (0 if touches else 2)
        for k in range(n - 1, at, -1):
            loop[k + added] = loop[k]
        for k in range(added):
            # Once around the hole from the entry on, and, over a bridge, back to where it began.
            loop[at + 1 + k] = first + (entry - first + k + (1 if touches else 0)) % (last - first)
        if not touches:
            loop[at + added] = loop[at]
        n += added
    return n


@kernel
def _is_free(
    flat: FloatArray,
    ring_starts: IntArray,
    first_ring: int,
    last_ring: int,
    loop: IntArray,
    n: int,
    i: int,
    end: int,
    touches: bool,
) -> bool:
    """
    Whether a corner is seen from corner i of a loop in the direction of its inside, with no edge between.

    Where rings touch nothing can lie between.
    """
    start = loop[i]
    before, after = loop[i - 1 if i else n - 1], loop[i + 1 if i + 1 < n else 0]
    left_of_in, left_of_out = turn(flat, before, start, end) > 0.0, turn(flat, start, after, end) > 0.0
    if turn(flat, before, start, after) > 0.0:
        if not (left_of_in and left_of_out):
            return False
    elif not (left_of_in or left_of_out):
        return False
    if touches:
        return True
    n_all = n + ring_starts[last_ring] - ring_starts[first_ring + 1]
    ring, previous = first_ring, loop[n - 1]
    for k in range(n_all):
        if k < n:
            here = loop[k]
        else:
            here = ring_starts[first_ring + 1] + k - n
            while ring == first_ring or here == ring_starts[ring + 1]:
                ring += 1
                previous = ring_starts[ring + 1] - 1
        # whether this edge meets the bridge elsewhere than in a common end
        if (
            _squared(flat, start, previous) != 0.0
            and _squared(flat, start, here) != 0.0
            and _squared(flat, end, previous) != 0.0
            and _squared(flat, end, here) != 0.0
            and turn(flat, start, end, previous) * turn(flat, start, end, here) <= 0.0
            and turn(flat, previous, here, start) * turn(flat, previous, here, end) <= 0.0
        ):
            return False
        previous = here
    return True


@kernel
def _cut_ears(
    flat: FloatArray, loop: IntArray, n: int, quality: FloatArray, triangles: IntArray, row: int
) -> None:
    """
    Cut the ears off a loop of n corners: each time the best one, in long loops the first good one.

    The quality of an ear is its height over its longest side as a share of that side; −1 for a straight
    corner, −2 for no ear, −3 for a corner that points inwards. Only ears beside one that is cut change, and
    those that had a corner inside.
    """
    for k in range(n):
        quality[k] = _UNKNOWN
    start = 0
    while n > 3:
        best, chosen = -np.inf, start
        for step in range(n):
            k = start + step if start + step < n else start + step - n
            if quality[k] == _UNKNOWN:
                quality[k] = _ear_quality(flat, loop, n, k)
            if quality[k] > best:
                best, chosen = quality[k], k
                if n > _MANY and quality[k] > 0.1:
                    break
        before, after = chosen - 1 if chosen else n - 1, chosen + 1 if chosen + 1 < n else 0
        triangles[row, 0], triangles[row, 1], triangles[row, 2] = loop[before], loop[chosen], loop[after]
        row += 1
        quality[before] = quality[after] = _UNKNOWN
        n -= 1
        for k in range(chosen, n):
            loop[k], quality[k] = loop[k + 1], quality[k + 1]
        for k in range(n):
            if quality[k] == _BLOCKED:
                quality[k] = _UNKNOWN
        start = chosen if chosen < n else 0
    for k in range(3):
        triangles[row, k] = loop[k]


@kernel
def _ear_quality(flat: FloatArray, loop: IntArray, n: int, k: int) -> float:
    a, b, c = loop[k - 1 if k else n - 1], loop[k], loop[k + 1 if k + 1 < n else 0]
    longest = np.sqrt(max(_squared(flat, a, b), _squared(flat, b, c), _squared(flat, c, a)))
    if longest == 0.0:
        return -1.0
    height = turn(flat, a, b, c) / longest
    if height < -_STRAIGHT:
        return -3.0
    for j in range(n):
        p = loop[j]
        if (
            turn(flat, a, b, p) >= 0.0
            and turn(flat, b, c, p) >= 0.0
            and turn(flat, c, a, p) >= 0.0
            and _squared(flat, p, a) != 0.0
            and _squared(flat, p, b) != 0.0
            and _squared(flat, p, c) != 0.0
        ):
            return _BLOCKED
    return height / longest if height > _STRAIGHT else -1.0


@kernel
def turn(flat: FloatArray, a: int, b: int, c: int) -> float:
    """Return twice the area of a triangle of rows, positive if counter-clockwise."""
    return (flat[b, 0] - flat[a, 0]) * (flat[c, 1] - flat[a, 1]) - (flat[b, 1] - flat[a, 1]) * (
        flat[c, 0] - flat[a, 0]
    )


@kernel
def _squared(flat: FloatArray, a: int, b: int) -> float:
    return (flat[a, 0] - flat[b, 0]) ** 2 + (flat[a, 1] - flat[b, 1]) ** 2
