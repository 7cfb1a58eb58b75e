"""What a vehicle sees, cut into short strips of its way: each is ready soon after it was passed."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import View
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.io.tiling.tile_stamps import stamp_of_number, stamp_of_time

Floats = NDArray[np.float64]

#: A strip is ready when the vehicle is so far beyond it [m]: by then its walls were seen from both sides.
BEYOND = 16.0
#: Points so far before and behind a strip come with it [m]: walls go on there.
CONTEXT = 10.0
#: So far beside the way points are taken [m]: those farther off are sparse, and of other streets.
BESIDE = 60.0
#: Places of the scanner nearer to the last one are left out; one that is farther off begins another way [m].
_STEP, _JUMP = 0.5, 20.0
#: Points are kept for so much of the way: a place is seen long before it is reached [m].
_KEPT = 120.0
#: Points that are kept at most (0.2 GB), if a vehicle stands that keeps all it sees.
_MOST_POINTS = 5_000_000
#: Strips that wait to be taken; the oldest go first.
_MOST_WAITING = 4


class RoadStrips:
    """
    Takes points with the places of their scanner, and gives out strips of a length [m], none if it is 0.

    Between two strips lies the line across the way: no point is of two of them, and few are of none, in
    curves. Of a vehicle that stands none is ready. `n_skipped` counts those that nobody took in time.
    """

    def __init__(self, length: float, frame: MapFrame) -> None:
        self.length, self.frame = length, frame
        self.ready: deque[PointTile] = deque()
        self.n_skipped = self._n_given = 0
        self._begin()

    def _begin(self) -> None:
        self._way = np.empty((0, 2))
        self._at = np.empty(0)  # length of the way at each of its places [m]
        self._next = -np.inf  # where the next strip begins: the first one has all that lies behind [m]
        self._blocks: deque[tuple[float, NDArray[Any]]] = deque()
        self._n_points = 0

    def add(self, records: NDArray[Any], way: Floats) -> None:
        """Take records from the street, and where the scanner was meanwhile, shape (n, 3) [m]."""
        if not self.length:
            return
        for place in way[:, :2]:
            self._go_to(place)
        if not len(self._at) or not len(records):
            return
        self._blocks.append((self._at[-1], records))
        while (end := max(self._next, 0.0) + self.length) + BEYOND <= self._at[-1]:
            self._cut(self._next, end)
            self._next = end
        self._n_points += len(records)
        while len(self._blocks) > 1 and (
            self._blocks[0][0] < self._next - _KEPT or self._n_points > _MOST_POINTS
        ):
            self._n_points -= len(self._blocks.popleft()[1])

    def end(self) -> None:
        """Make all that is left the last strip of this way, as nothing more comes."""
        if self._blocks:
            self._cut(self._next, np.inf)
        self._begin()

    def _go_to(self, place: Floats) -> None:
        step = float(np.hypot(*(place - self._way[-1]))) if len(self._way) else 0.0
        if step > _JUMP:
            self.end()
            step = 0.0
        if step >= _STEP or not len(self._way):
            reached = self._at[-1] + step if len(self._at) else 0.0
            kept = self._at > reached - _KEPT - BEYOND
            self._way = np.vstack([self._way[kept], place])
            self._at = np.append(self._at[kept], reached)

    def _cut(self, begin: float, end: float) -> None:
        records = np.concatenate([block for _, block in self._blocks])
        xy = np.stack([records[axis] for axis in "xy"], axis=1).astype(np.float64)
        middle, _ = self._place(0.5 * (max(begin, 0.0) + min(end, self._at[-1])))
        records = records.compress(np.hypot(*(xy - middle).T) <= BESIDE + CONTEXT)
        xy = np.stack([records[axis] for axis in "xy"], axis=1).astype(np.float64)
        past = [self._are_past(xy, at) for at in (begin - CONTEXT, begin, end, end + CONTEXT)]
        records, is_core = records.compress(past[0] & ~past[3]), (past[1] & ~past[2])[past[0] & ~past[3]]
        if not is_core.any():
            return
        self._n_given += 1
        last = float(records["gps_time"].max())
        self.ready.append(
            PointTile(
                np.stack([records[axis] for axis in "xyz"], axis=1),
                buffer=~is_core,
                view=np.full(len(records), View.STREET),
                stamp=stamp_of_time(last, is_standard=True) or stamp_of_number(self._n_given),
                frame=self.frame,
            )
        )
        while len(self.ready) > _MOST_WAITING:
            self.ready.popleft()
            self.n_skipped += 1

    def _place(self, at: float) -> tuple[Floats, Floats]:
        """Return a place on the way, and its direction there."""
        ends = np.clip([at - _STEP, at, at + _STEP], self._at[0], self._at[-1])
        before, place, after = np.stack([np.interp(ends, self._at, axis) for axis in self._way.T], axis=1)
        return place, after - before

    def _are_past(self, xy: Floats, at: float) -> NDArray[np.bool_]:
        """Tell which positions lie beyond the line across the way at a place of it."""
        if np.isinf(at):
            return np.full(len(xy), at < 0.0)
        place, direction = self._place(at)
        return np.asarray((xy - place) @ direction >= 0.0)
