"""
The faces of a shell as arrays, and cut into triangles: ears first, then flipped until all are Delaunay's.

Holes are joined to the exterior by bridges (Eberly 2002), ears are cut off best first (Meisters 1975), and
diagonals are flipped (Lawson 1977), which gives the constrained Delaunay triangulation of the face.

Written out, not `shapely.constrained_delaunay_triangles`: with that 1500 solids of `bench.models.solids` took
6.4 s in place of 5.0, 55 of them came out in other triangles, and Ubuntu 24.04's shapely has none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, pairwise

import numpy as np

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.solids.shell import Face, Solid, cross


@dataclass(frozen=True, eq=False)
class FaceArrays:
    """A shell's faces, flat."""

    vertices: FloatArray  #: map frame [m], shape (n_vertices, 3)
    corners: IntArray  #: rows of the vertices, ring by ring, shape (n_corners,)
    ring_starts: IntArray  #: where each ring begins among the corners, shape (n_rings + 1,)
    face_starts: IntArray  #: where each face begins among the rings, shape (n_faces + 1,)

    @property
    def corner_starts(self) -> IntArray:
        """Where each face begins among the corners, shape (n_faces + 1,)."""
        return self.ring_starts[self.face_starts]

    def solid(self, semantics: tuple[str, ...]) -> Solid:
        """Return the shell whose faces are these."""
        corners, starts = self.corners.tolist(), self.ring_starts.tolist()
        rings = [tuple(corners[a:b]) for a, b in pairwise(starts)]
        faces = tuple(tuple(rings[a:b]) for a, b in pairwise(self.face_starts.tolist()))
        return Solid(self.vertices, faces, semantics)


def face_arrays(solid: Solid) -> FaceArrays:
    """Return the faces of a solid."""
    rings = list(chain.from_iterable(solid.faces))
    sizes = np.array([len(ring) for ring in rings], dtype=np.int64)
    corners = np.fromiter(chain.from_iterable(rings), dtype=np.int64, count=int(sizes.sum()))
    per_face = np.array([len(face) for face in solid.faces], dtype=np.int64)
    return FaceArrays(solid.vertices, corners, starts_of(sizes), starts_of(per_face))


def fitted_planes(faces: FaceArrays) -> tuple[FloatArray, FloatArray]:
    """
    Return each face's largest distance to its plane [m], and the corners' coordinates in the planes [m].

    The planes are least-squares planes through all corners of a face. In its own plane every exterior runs
    counter-clockwise.
    """
    starts = faces.corner_starts
    counts = starts[1:] - starts[:-1]
    points = faces.vertices[faces.corners]
    centres = np.add.reduceat(points, starts[:-1]) / counts[:, None]
    offsets = points - centres.repeat(counts, axis=0)
    products = (offsets[:, :, None] * offsets[:, None, :]).reshape(-1, 9)
    moments = np.add.reduceat(products, starts[:-1]).reshape(-1, 3, 3)
    axes = np.linalg.eigh(moments)[1].repeat(counts, axis=0)
    local = np.einsum("ni,nij->nj", offsets, axes)
    off_plane = np.maximum.reduceat(np.abs(local[:, 0]), starts[:-1])
    flat = local[:, 2:0:-1].copy()
    clockwise = ring_areas(faces, flat)[faces.face_starts[:-1]] < 0.0
    flat[np.repeat(clockwise, np.diff(faces.corner_starts)), 1] *= -1.0
    return off_plane, flat


def ring_areas(faces: FaceArrays, flat: FloatArray) -> FloatArray:
    """Return the area inside each ring, positive if it runs counter-clockwise [m²]."""
    following = np.arange(1, len(flat) + 1)
    following[faces.ring_starts[1:] - 1] = faces.ring_starts[:-1]
    after = flat[following]
    cross = flat[:, 0] * after[:, 1] - flat[:, 1] * after[:, 0]
    return 0.5 * np.add.reduceat(cross, faces.ring_starts[:-1])


def starts_of(sizes: IntArray) -> IntArray:
    """Return where each of consecutive groups begins, and where the last one ends."""
    starts = np.zeros(len(sizes) + 1, dtype=np.int64)
    sizes.cumsum(out=starts[1:])
    return starts


#: Sine of an angle that counts as nothing: flips that gain no more could go on for ever.
_NO_GAIN = 1e-9


@kernel
def flip_to_delaunay(flat, corners, rows, begin, end, across):  # type: ignore[no-untyped-def]
    """
    Flip the inner edges of triangles in place, as Lawson (1977), until all are locally Delaunay.

    `flat` are coordinates of corners (n_corners, 2) [m], `corners` the vertex of each: corners of one vertex
    are one place. `rows` are corners of triangles, counter-clockwise (n_triangles, 3); those from `begin` to
    `end` are looked at, and have only each other beside them. `across` is room for the triangles across each
    edge (from corner k to k + 1), −1 at the border.
    """
    n = end - begin
    for t in range(n):
        for k in range(3):
            across[t, k] = -1
    for t in range(n):
        for k in range(3):
            a, b = corners[rows[begin + t, k]], corners[rows[begin + t, k + 1 if k < 2 else 0]]
            for other in range(t + 1, n):
                for j in range(3):
                    if (
                        corners[rows[begin + other, j]] == b
                        and corners[rows[begin + other, j + 1 if j < 2 else 0]] == a
                    ):
                        across[t, k] = other
                        across[other, j] = t
    for _ in range(2 * n + 4):
        changed = False
        for t in range(n):
            for k in range(3):
                other = across[t, k]
                if other <= t:
                    continue
                j = _edge_towards(across, other, t)
                a, b = rows[begin + t, k], rows[begin + t, (k + 1) % 3]
                c, d = rows[begin + t, (k + 2) % 3], rows[begin + other, (j + 2) % 3]
                if corners[c] == corners[d] or not _should_flip(flat, a, b, c, d):
                    continue
                # replace the common edge ab of triangles abc and bad by cd
                changed = True
                beyond_bc, beyond_ca = across[t, (k + 1) % 3], across[t, (k + 2) % 3]
                beyond_ad, beyond_db = across[other, (j + 1) % 3], across[other, (j + 2) % 3]
                rows[begin + t, 0], rows[begin + t, 1], rows[begin + t, 2] = c, a, d
                across[t, 0], across[t, 1], across[t, 2] = beyond_ca, beyond_ad, other
                rows[begin + other, 0], rows[begin + other, 1], rows[begin + other, 2] = d, b, c
                across[other, 0], across[other, 1], across[other, 2] = beyond_db, beyond_bc, t
                if beyond_ad >= 0:
                    across[beyond_ad, _edge_towards(across, beyond_ad, other)] = t
                if beyond_bc >= 0:
                    across[beyond_bc, _edge_towards(across, beyond_bc, t)] = other
        if not changed:
            return


@kernel
def _edge_towards(across: IntArray, t: int, other: int) -> int:
    for k in range(3):
        if across[t, k] == other:
            return k
    return -1


@kernel
def _should_flip(flat: FloatArray, a: int, b: int, c: int, d: int) -> bool:
    """Whether the angles opposite edge ab add up to more than 180° and the other diagonal lies inside."""
    if _angle(flat, c, a, d)[0] <= 0.0 or _angle(flat, d, b, c)[0] <= 0.0:
        return False
    sine_c, cosine_c = _angle(flat, c, a, b)
    sine_d, cosine_d = _angle(flat, d, b, a)
    return sine_c * cosine_d + cosine_c * sine_d < -_NO_GAIN


@inner_kernel
def _angle(flat: FloatArray, p: int, q: int, r: int) -> tuple[float, float]:
    ux, uy = flat[q, 0] - flat[p, 0], flat[q, 1] - flat[p, 1]
    vx, vy = flat[r, 0] - flat[p, 0], flat[r, 1] - flat[p, 1]
    size = np.sqrt((ux * ux + uy * uy) * (vx * vx + vy * vy))
    return ((ux * vy - uy * vx) / size, (ux * vx + uy * vy) / size) if size > 0.0 else (0.0, 1.0)


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
def _triangulate_all(flat, corners, ring_starts, face_starts, starts, triangles):  # type: ignore[no-untyped-def]
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
def _join_holes(flat, corners, ring_starts, first_ring, last_ring, loop, n):  # type: ignore[no-untyped-def]
    """Join a face's holes to the first n corners of a loop, its exterior, and return how many it has then."""
    # The rightmost hole left is the next: joined at a common vertex, else by the shortest bridge in sight.
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
def _is_free(flat, ring_starts, first_ring, last_ring, loop, n, i, end, touches):  # type: ignore[no-untyped-def]
    """Whether corner i of a loop sees a corner on its inside; nothing lies between where rings touch."""
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
def _cut_ears(flat, loop, n, quality, triangles, row):  # type: ignore[no-untyped-def]
    """Cut the ears off a loop of n corners: each time the best one, in long loops the first good one."""
    # An ear's quality is its height over its longest side; −1: straight, −2: no ear, −3: points inwards.
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


@inner_kernel
def _squared(flat: FloatArray, a: int, b: int) -> float:
    return (flat[a, 0] - flat[b, 0]) ** 2 + (flat[a, 1] - flat[b, 1]) ** 2


#: Rows of three vertices, counter-clockwise as their face is.
Triangle = tuple[int, int, int]


def face_pieces(vertices: FloatArray, faces: Sequence[Face]) -> list[list[tuple[int, ...]]]:
    """
    Divide each face of a solid into convex pieces that have every edge of its rings as an edge.

    Vertices are (n_vertices, 3) [m]. Returned are rows of them, face by face: the face itself if it is a
    triangle or a convex quadrilateral, else the triangles by which it is checked.
    """
    pieces: list[list[tuple[int, ...]]] = [list(face) for face in faces]
    fours = [k for k, face in enumerate(faces) if len(face) == 1 and len(face[0]) == 4]
    corners = np.array([faces[k][0] for k in fours], dtype=np.intp).reshape(-1, 4)
    whole = {k for k, is_convex in zip(fours, _are_convex(vertices[corners]), strict=True) if is_convex}
    others = [k for k, face in enumerate(faces) if k not in whole and (len(face) > 1 or len(face[0]) != 3)]
    if others:
        arrays = face_arrays(Solid(vertices, tuple(faces[k] for k in others), ()))
        triangles, face_of = triangulate(arrays, fitted_planes(arrays)[1])
        rows = list(map(tuple, triangles.tolist()))
        first = np.searchsorted(face_of, np.arange(len(others) + 1)).tolist()
        for k, (begin, end) in zip(others, pairwise(first), strict=True):
            pieces[k] = rows[begin:end]
    return pieces


def triangles_of(pieces: Sequence[tuple[int, ...]]) -> list[Triangle]:
    """Divide convex pieces of three or four corners into triangles."""
    return [(piece[0], piece[k], piece[k + 1]) for piece in pieces for k in range(1, len(piece) - 1)]


def _are_convex(corners: FloatArray) -> BoolArray:
    """Whether all four corners turn the same way, for rings of shape (n, 4, 3)."""
    sides = np.roll(corners, -1, axis=1) - corners
    first = cross(sides[:, 3], sides[:, 0])
    turns = [cross(sides[:, k], sides[:, k + 1]) for k in range(3)]
    return np.all([(first * turn).sum(axis=1) > 0.0 for turn in turns], axis=0)
