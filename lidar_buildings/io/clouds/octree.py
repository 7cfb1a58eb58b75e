"""An octree of points with levels of detail, as COPC files have it: each point lies in one node."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

#: Bits of a coordinate within the tree's cube: three of them fit 63.
BITS = 21
#: A node's points lie in cells of its side divided by two to this power, one in each.
SAMPLE_BITS = 7
#: Level of the deepest nodes: their cells have all bits.
DEEPEST = BITS - SAMPLE_BITS
#: A node with fewer points than this has no children: about what one request of a reader fetches.
_LEAF = 20_000


class Cube(NamedTuple):
    """The cube of the root: its lower corner and its side."""

    corner: NDArray[np.float64]
    side: float

    @classmethod
    def around(cls, low: NDArray[np.float64], high: NDArray[np.float64]) -> Cube:
        """Return the smallest cube around a box that has its lower corner, which is where copclib puts it."""
        return cls(low, float((high - low).max()) or 1.0)

    def codes(self, places: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the Morton codes of places, shape (n, 3): the bits of x, y and z in turns, x lowest."""
        steps = np.floor((places - self.corner) * (2.0**BITS / self.side)).astype(np.int64)
        x, y, z = (_spread(column) for column in np.clip(steps, 0, 2**BITS - 1).T)
        return x | y << 1 | z << 2


def cells_of(codes: NDArray[np.int64], level: int) -> NDArray[np.int64]:
    """Return the codes of the nodes of a level in which places lie that have these codes."""
    return codes >> 3 * (BITS - level)


class Node(NamedTuple):
    """A node: its level, 0 for the root, and its Morton code among those of the level."""

    level: int
    code: int

    @property
    def place(self) -> tuple[int, int, int]:
        """Number of the node along x, y and z."""
        x, y, z = (_gathered(self.code >> axis) for axis in range(3))
        return x, y, z


def nodes_of(codes: NDArray[np.int64], depth: int) -> Iterator[tuple[Node, NDArray[np.intp]]]:
    """
    Yield the nodes of points of one cell of the tree, or of some of it, and the rows of each.

    From the root down each node takes a point of each of its cells, the one with the lowest Morton code at
    the level `depth`; where few are left, all of them. Nodes above may have further points elsewhere, and are
    no leaves.
    """
    order = np.argsort(codes, kind="stable")
    left, levels = codes[order], np.full(len(codes), DEEPEST)
    rows = np.arange(len(codes))
    for level in range(DEEPEST):
        if level >= depth:
            starts, sizes = _runs(cells_of(left, level))
            is_taken = np.repeat(sizes < _LEAF, sizes)
        else:
            is_taken = np.zeros(len(left), dtype=bool)
        starts, _ = _runs(cells_of(left, level + SAMPLE_BITS))
        is_taken[starts] = True
        levels[rows[is_taken]] = level
        left, rows = left[~is_taken], rows[~is_taken]
    own = codes[order] >> 3 * (BITS - levels)
    by_node = np.lexsort((own, levels))
    starts, sizes = _runs(own[by_node] << 4 | levels[by_node])
    for start, size in zip(starts.tolist(), sizes.tolist(), strict=True):
        members = by_node[start : start + size]
        yield Node(int(levels[members[0]]), int(own[members[0]])), order[members]


def _runs(values: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return where runs of equal values begin, and their lengths."""
    if not len(values):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    starts = np.flatnonzero(np.r_[True, values[1:] != values[:-1]])
    return starts, np.diff(starts, append=len(values))


def _spread(bits: NDArray[np.int64]) -> NDArray[np.int64]:
    """Put two zeros between any two bits."""
    for shift, mask in (
        (32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F), (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):  # fmt: skip
        bits = (bits | bits << shift) & mask
    return bits


def _gathered(code: int) -> int:
    """Return the number of every third bit."""
    return sum((code >> 3 * bit & 1) << bit for bit in range(BITS))
