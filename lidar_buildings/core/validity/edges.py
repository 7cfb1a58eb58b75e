"""
How the faces of a shell hang together: every edge twice, once in each direction, all in one piece.

"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.validity.face_arrays import FaceArrays


def broken_edges(faces: FaceArrays) -> set[int]:
    """
    Return the codes 302, 303, 305 and 307 of a shell of sound faces.

    """
    starts, ends = _half_edges(faces)
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    keys = low * len(faces.vertices) + high
    order = np.argsort(keys, kind="stable")
    first = np.flatnonzero(np.diff(keys[order], prepend=-1))
    uses = np.diff(np.append(first, len(keys)))
    codes = set()
    if (uses == 1).any():
        codes.add(302)
    if (uses > 2).any():
        codes.add(303)
    pairs = order[first[uses == 2][:, None] + [0, 1]]
    if (starts[pairs[:, 0]] == starts[pairs[:, 1]]).any():
        codes.add(307)
    face_of = np.repeat(np.arange(len(faces.face_starts) - 1), np.diff(faces.corner_starts))
    if _n_parts(face_of[pairs], len(faces.face_starts) - 1) > 1:
        codes.add(305)
    if codes <= {305} and _n_umbrellas(faces.ring_starts, pairs) > len(np.unique(faces.corners)):
        codes.add(303)
    return codes


def _half_edges(faces: FaceArrays) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Return where each directed edge begins and ends, one per corner.

    """
    following = np.arange(1, len(faces.corners) + 1)
    following[faces.ring_starts[1:] - 1] = faces.ring_starts[:-1]
    return faces.corners, faces.corners[following]


@njit(cache=True, nogil=True)
def _n_parts(joined: NDArray[np.int64], n_faces: int) -> int:
    """
    Return the number of parts of a shell that share no edge.

    """
    leader = np.arange(n_faces)
    parts = n_faces
    for i in range(len(joined)):
        a, b = joined[i, 0], joined[i, 1]
        while leader[a] != a:
            leader[a] = leader[leader[a]]
            a = leader[a]
        while leader[b] != b:
            leader[b] = leader[leader[b]]
            b = leader[b]
        if a != b:
            leader[max(a, b)] = min(a, b)
            parts -= 1
    return parts


@njit(cache=True, nogil=True)
def _n_umbrellas(ring_starts: NDArray[np.int64], pairs: NDArray[np.int64]) -> int:
    """
    Return the number of closed fans of faces: one per vertex unless parts meet in a single vertex.

    From a half-edge one comes to the next of its fan by taking the one before it in its ring, backwards.

    """
    n = ring_starts[-1]
    opposite = np.empty(n, dtype=np.int64)
    for i in range(len(pairs)):
        opposite[pairs[i, 0]], opposite[pairs[i, 1]] = pairs[i, 1], pairs[i, 0]
    before = np.arange(-1, n - 1)
    for k in range(len(ring_starts) - 1):
        before[ring_starts[k]] = ring_starts[k + 1] - 1
    seen = np.zeros(n, dtype=np.bool_)
    count = 0
    for start in range(n):
        if not seen[start]:
            count += 1
            edge = start
            while not seen[edge]:
                seen[edge] = True
                edge = opposite[before[edge]]
    return count
