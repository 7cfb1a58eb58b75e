"""What a vehicle sees, by squares of the map: each is ready when it was passed, or nothing new comes."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from lidar_buildings.core.model.classes import View
from lidar_buildings.core.model.ids import STEP
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.io.tiling.tile_grid import Cell
from lidar_buildings.io.tiling.tile_stamps import stamp_of_number, stamp_of_time

Floats = NDArray[np.float64]

#: A square to which the vehicle came so near is ready when it is so far beyond it [m]: by then its walls were
#: seen from both sides.
NEAR, BEYOND = 40.0, 24.0
#: A square is ready when so long nothing new was seen in some parts of it that have new points [s], ...
QUIET = 0.5
#: ... so many of what stands above ground, and such a share of the square's, ...
NEW_POINTS, NEW_SHARE = 20, 0.05
#: ... and so long after it was given out last [s].
AGAIN = 1.0
#: Points so far around a square come with it [m]: walls go on there, and stand before and behind others.
CONTEXT = 8.0
#: What is higher than the lowest point of its part of a square stands above ground; sides of the parts [m].
RAISED, _PART = 0.5, 2.0
#: Points of squares farther off are forgotten [m], and those of the oldest if they are more (0.2 GB).
_KEPT, _MOST_POINTS = 150.0, 5_000_000
#: Time between two looks [s]: squares that become ready together share their surroundings.
_LOOK = 0.25
#: Messages that wait to be taken; the oldest go first.
_MOST_WAITING = 16


class RoadPlaces:
    """
    Takes points with the places of their scanner, and gives out squares of a side [m], none if it is 0.

    A square comes with all of its points, and with those around it as context; squares side by side that are
    ready at once come together. It comes again when more was seen in it, until the vehicle is far away.
    `n_skipped` counts the messages that nobody took in time.
    """

    def __init__(self, side: float, frame: MapFrame) -> None:
        self.side, self.frame = side, frame
        self.ready: deque[PointTile] = deque()
        self.n_skipped = self._stamp = 0
        self._n_parts = max(1, round(side / _PART))
        #: Row of each square in what follows, −1 of those that were forgotten.
        self._rows: dict[Cell, int] = {}
        self._blocks: list[list[NDArray[Any]]] = []
        self._cells = np.empty((0, 2), dtype=np.int64)
        self._n_points = np.empty(0, dtype=np.int64)
        self._nearest = np.empty(0)  # how near the vehicle came [m]
        self._is_passed = np.empty(0, dtype=bool)
        self._given = np.empty(0)  # when it was given out last [s]
        #: Of the parts: the lowest point [m], when something raised was seen there last [s], how many such
        #: points there are, and how many were given out.
        self._low, self._seen = np.empty((2, 0, self._n_parts**2))
        self._raised, self._shown = np.empty((2, 0, self._n_parts**2), dtype=np.int64)
        self._now = self._looked = -np.inf

    def add(self, records: NDArray[Any], way: Floats) -> None:
        """Take records from the street, and where the scanner was meanwhile, shape (n, 3) [m]."""
        if not self.side or not len(records):
            return
        self._keep(records)
        self._now = max(self._now, float(records["gps_time"].max()))
        is_moved = np.zeros(len(self._cells), dtype=bool)
        away = np.zeros(len(self._cells))
        for place in way[:, :2]:
            away = np.hypot(*((self._cells + 0.5) * self.side - place).T)
            self._nearest = np.minimum(self._nearest, away)
            is_moved |= away**2 - self._nearest**2 >= BEYOND**2
        if self._now < self._looked + _LOOK:
            return
        self._looked = self._now
        is_past = is_moved & ~self._is_passed & (self._nearest <= NEAR)
        self._is_passed |= is_past
        is_quiet = self._now - self._seen >= QUIET
        n_new = ((self._raised - self._shown) * (is_quiet | is_past[:, None])).sum(axis=1)
        is_new = n_new >= np.maximum(NEW_POINTS, NEW_SHARE * self._raised.sum(axis=1))
        self._give(is_new & (is_past | (self._now - self._given >= AGAIN)))
        self._forget(away)

    def end(self) -> None:
        """Make all squares ready that have something new, as nothing more comes."""
        self._give((self._raised - self._shown).sum(axis=1) >= NEW_POINTS)

    def _keep(self, records: NDArray[Any]) -> None:
        xy = np.stack([records[axis] for axis in "xy"], axis=1).astype(np.float64) / self.side
        cells = np.floor(xy).astype(np.int64)
        _, first, square = np.unique(cells @ [2**32, 1], return_index=True, return_inverse=True)
        for cell in map(tuple, cells[first].tolist()):
            if cell not in self._rows:
                self._rows[cell] = len(self._blocks)
                self._blocks.append([])
        self._grow()
        row = np.array([self._rows[one] for one in map(tuple, cells[first].tolist())])[square.reshape(-1)]
        own = np.flatnonzero(row >= 0)
        records, row = records.take(own), row[own]
        column, line = np.floor((xy - cells)[own] * self._n_parts).astype(np.int64).T
        part, z = line * self._n_parts + column, records["z"].astype(np.float64)
        np.minimum.at(self._low, (row, part), z)
        is_raised = z > self._low[row, part] + RAISED
        self._n_points += np.bincount(row, minlength=len(self._blocks))
        raised = row[is_raised], part[is_raised]
        np.add.at(self._raised, raised, 1)
        np.maximum.at(self._seen, raised, records["gps_time"][is_raised])
        order = np.argsort(row, kind="stable")
        ends = np.flatnonzero(np.diff(row[order])) + 1
        for rows in np.split(order, ends):
            if len(rows):
                self._blocks[row[rows[0]]].append(records.take(rows))

    def _grow(self) -> None:
        """Make room for the squares that are new."""
        n_new = len(self._blocks) - len(self._cells)
        if not n_new:
            return
        new = [cell for cell, row in self._rows.items() if row >= len(self._cells)]
        self._cells = np.vstack([self._cells, new])
        self._n_points = np.append(self._n_points, np.zeros(n_new, dtype=np.int64))
        self._nearest = np.append(self._nearest, np.full(n_new, np.inf))
        self._is_passed = np.append(self._is_passed, np.zeros(n_new, dtype=bool))
        self._given = np.append(self._given, np.full(n_new, -np.inf))
        parts = (n_new, self._low.shape[1])
        self._low = np.vstack([self._low, np.full(parts, np.inf)])
        self._seen = np.vstack([self._seen, np.full(parts, -np.inf)])
        self._raised = np.vstack([self._raised, np.zeros(parts, dtype=np.int64)])
        self._shown = np.vstack([self._shown, np.zeros(parts, dtype=np.int64)])

    def _forget(self, away: Floats) -> None:
        """Forget what is far away: what is seen of it later comes with its tile alone."""
        is_far = away > _KEPT
        if self._n_points.sum() > _MOST_POINTS:
            is_far[np.argmin(self._seen.max(axis=1))] = True
        if is_far.any():
            kept = np.flatnonzero(~is_far)
            self._rows = dict.fromkeys(self._rows, -1)
            self._rows |= {tuple(cell): k for k, cell in enumerate(self._cells[kept].tolist())}
            self._blocks = [self._blocks[row] for row in kept.tolist()]
            self._cells, self._n_points = self._cells[kept], self._n_points[kept]
            self._nearest, self._is_passed = self._nearest[kept], self._is_passed[kept]
            self._given, self._low, self._seen = self._given[kept], self._low[kept], self._seen[kept]
            self._raised, self._shown = self._raised[kept], self._shown[kept]

    def _give(self, is_ready: NDArray[np.bool_]) -> None:
        if not is_ready.any():
            return
        self._shown[is_ready], self._given[is_ready] = self._raised[is_ready], self._now
        for rows in self._side_by_side(np.flatnonzero(is_ready)):
            self.ready.append(self._cut(rows))
        while len(self.ready) > _MOST_WAITING:
            self.ready.popleft()
            self.n_skipped += 1

    def _side_by_side(self, rows: NDArray[np.intp]) -> Iterator[NDArray[np.intp]]:
        """Yield the rows of squares that touch one another."""
        cells = self._cells[rows] - self._cells[rows].min(axis=0)
        plan = np.zeros(cells.max(axis=0) + 1, dtype=np.int8)
        plan[tuple(cells.T)] = 1
        group = label(plan)[0][tuple(cells.T)]
        for number in range(1, int(group.max()) + 1):
            yield rows[group == number]

    def _cut(self, core: NDArray[np.intp]) -> PointTile:
        reach = int(np.ceil(CONTEXT / self.side))
        steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2), axis=-1).reshape(-1, 2)
        around = {tuple(one) for one in (self._cells[core][:, None] + steps).reshape(-1, 2).tolist()}
        own = {tuple(one) for one in self._cells[core].tolist()}
        inside = [self._joined(self._rows[one]) for one in sorted(own)]
        beside = [self._joined(row) for one in sorted(around - own) if (row := self._rows.get(one, -1)) >= 0]
        context = np.concatenate([inside[0][:0], *beside])
        xy = np.stack([context[axis] for axis in "xy"], axis=1).astype(np.float64)
        is_near = np.zeros(len(xy), dtype=bool)
        for low in self._cells[core] * self.side:
            is_near |= ((xy >= low - CONTEXT) & (xy <= low + self.side + CONTEXT)).all(axis=1)
        n_core = sum(map(len, inside))
        records = np.concatenate([*inside, context.compress(is_near)])
        stamp = stamp_of_time(float(records["gps_time"].max()), is_standard=True)
        self._stamp = max(stamp or stamp_of_number(1), self._stamp + STEP)
        return PointTile(
            np.stack([records[axis] for axis in "xyz"], axis=1),
            buffer=np.arange(len(records)) >= n_core,
            view=np.full(len(records), View.STREET),
            stamp=self._stamp,
            frame=self.frame,
        )

    def _joined(self, row: int) -> NDArray[Any]:
        """Return the points of a square."""
        if len(self._blocks[row]) > 1:
            self._blocks[row] = [np.concatenate(self._blocks[row])]
        return self._blocks[row][0]
