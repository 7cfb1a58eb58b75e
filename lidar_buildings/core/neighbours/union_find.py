"""
Union-find: sets that grow together by links, the same whatever the order of the links.

Not scipy's connected components: kernels link as they find, and each set is named by its lowest member. A
forest is an int array, at first each member's own number; the lowest number of a set is its root.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel


def sets_of_pairs(count: int, one: NDArray[np.integer], other: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return, for each of `count` members, the lowest number of the set that pairs link it to."""
    parent = np.arange(count)
    _link_pairs(parent, np.ascontiguousarray(one, np.int64), np.ascontiguousarray(other, np.int64))
    return parent


def numbered(sets: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number sets, each of which is named by its lowest member, from 0 in the order of these."""
    return (np.cumsum(sets == np.arange(len(sets))) - 1)[sets]


@inner_kernel
def root(parent, i):  # type: ignore[no-untyped-def]
    """Return the lowest number of the set that i is in, shortening the way to it."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@inner_kernel
def link(parent, i, j):  # type: ignore[no-untyped-def]
    """Make one set of those of i and j."""
    i, j = root(parent, i), root(parent, j)
    parent[max(i, j)] = min(i, j)


@kernel
def flatten(parent):  # type: ignore[no-untyped-def]
    """Give every member the number of its set."""
    for i in range(len(parent)):
        parent[i] = root(parent, i)


@kernel
def _link_pairs(parent, one, other):  # type: ignore[no-untyped-def]
    for i in range(len(one)):
        link(parent, one[i], other[i])
    flatten(parent)
