"""The rings of a roof's pieces in steps of the output grid, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.solids.raising.roof_piece import RoofPiece


class GridRings(NamedTuple):
    """Rings end to end, without repetitions and spikes."""

    corners: IntArray  #: open rings [steps of the grid], shape (n_corners, 2)
    starts: IntArray  #: where each ring begins among the corners, shape (n_rings + 1,)
    #: The piece that lies to the left of each ring: its exterior, counter-clockwise, comes before its holes,
    #: shape (n_rings,).
    owner: IntArray

    @property
    def following(self) -> IntArray:
        """The next corner along its ring of each corner."""
        following = np.arange(1, len(self.corners) + 1)
        following[self.starts[1:] - 1] = self.starts[:-1]
        return following

    @property
    def is_exterior(self) -> BoolArray:
        """Whether each ring is its piece's exterior."""
        return first_of_each(self.owner)


def piece_rings(pieces: Sequence[RoofPiece]) -> GridRings:
    """Return the rings of pieces; none of a piece whose exterior has no area."""
    rings = [ring for one in pieces for ring in one.rings]
    if not rings:
        return GridRings(np.empty((0, 2), np.int64), np.zeros(1, np.int64), np.empty(0, np.int64))
    owner = np.repeat(np.arange(len(pieces)), [len(one.rings) for one in pieces])
    starts = np.cumsum([0, *map(len, rings)])
    return grid_rings(np.concatenate(rings) / GRID, starts, first_of_each(owner), owner)


def first_of_each(owner: IntArray) -> BoolArray:
    """Say of each ring whether its owner is another one than that of the ring before."""
    is_first = np.ones(len(owner), dtype=np.bool_)
    is_first[1:] = owner[1:] != owner[:-1]
    return is_first


def grid_rings(
    corners: FloatArray | IntArray, starts: IntArray, is_exterior: BoolArray, owner: IntArray
) -> GridRings:
    """
    Put rings, in steps of the grid, on it: exteriors counter-clockwise, the holes that follow each clockwise.
    """
    corners, starts, owner = np.rint(corners).astype(np.int64), starts.copy(), owner.copy()
    n_rings = _clean(corners, starts, is_exterior, owner)
    return GridRings(corners[: starts[n_rings]], starts[: n_rings + 1], owner[:n_rings])


@kernel
def _clean(corners: IntArray, starts: IntArray, is_exterior: BoolArray, owner: IntArray) -> int:
    """Leave out repetitions, spikes, and rings without area, in place; return how many rings are left."""
    n_rings, filled, keeps_holes = 0, 0, False
    begin = starts[0]
    for number in range(len(owner)):
        end = starts[number + 1]
        first = filled
        for k in range(begin, end):
            x, y = corners[k, 0], corners[k, 1]
            if filled > first and corners[filled - 1, 0] == x and corners[filled - 1, 1] == y:
                continue
            if filled > first + 1 and corners[filled - 2, 0] == x and corners[filled - 2, 1] == y:
                filled -= 1  # back along the last edge
                continue
            corners[filled, 0], corners[filled, 1] = x, y
            filled += 1
        begin, head = end, first
        while filled - head > 2:
            is_last = (
                corners[filled - 1, 0] == corners[head, 0] and corners[filled - 1, 1] == corners[head, 1]
            )
            is_tip = corners[filled - 2, 0] == corners[head, 0] and corners[filled - 2, 1] == corners[head, 1]
            if is_last or is_tip:
                filled -= 1
            elif (
                corners[filled - 1, 0] == corners[head + 1, 0]
                and corners[filled - 1, 1] == corners[head + 1, 1]
            ):
                head += 1
            else:
                break
        if is_exterior[number]:
            keeps_holes = filled - head > 2
        if filled - head < 3 or not keeps_holes:
            filled = first
            continue
        doubled_area = 0
        for k in range(head, filled):
            after = k + 1 if k + 1 < filled else head
            doubled_area += (corners[k, 0] - corners[head, 0]) * (corners[after, 1] - corners[head, 1])
            doubled_area -= (corners[k, 1] - corners[head, 1]) * (corners[after, 0] - corners[head, 0])
        for k in range(head, filled):
            corners[first + k - head, 0], corners[first + k - head, 1] = corners[k, 0], corners[k, 1]
        filled -= head - first
        if (doubled_area > 0) != is_exterior[number]:
            for k in range((filled - first) // 2):
                for axis in range(2):
                    low, high = corners[first + k, axis], corners[filled - 1 - k, axis]
                    corners[first + k, axis], corners[filled - 1 - k, axis] = high, low
        owner[n_rings] = owner[number]
        n_rings += 1
        starts[n_rings] = filled
    return n_rings
