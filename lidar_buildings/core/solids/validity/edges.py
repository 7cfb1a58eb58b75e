"""How the faces of a shell hang together: every edge twice, once in each direction, all in one piece."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.model.array_types import IntArray
from lidar_buildings.core.neighbours.union_find import sets_of_pairs


def broken_edges(triangles: IntArray) -> set[int]:
    """
    Return the codes 302, 303, 305 and 307 of a shell whose faces are cut into triangles.

    Triangles, and not rings, because a hole may touch the exterior of its face at a vertex.
    """
    starts, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    keys = low * (high.max() + 1) + high
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
    same = np.flatnonzero(np.diff(keys[order]) == 0)
    if sets_of_pairs(len(triangles), order[same] // 3, order[same + 1] // 3).any():
        codes.add(305)
    if codes <= {305} and _n_umbrellas(pairs, len(keys)) > len(np.unique(starts)):
        codes.add(303)
    return codes


def _n_umbrellas(pairs: IntArray, n: int) -> int:
    """
    Return the number of closed fans of triangles: one per vertex unless parts meet in a single vertex.

    From a half-edge one comes to the next of its fan by taking the one before it in its triangle, backwards.
    """
    opposite = np.empty(n, dtype=np.int64)
    opposite[pairs] = pairs[:, ::-1]
    edges = np.arange(n)
    return len(np.unique(sets_of_pairs(n, edges, opposite[edges + np.where(edges % 3, -1, 2)])))
