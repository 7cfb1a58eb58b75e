"""Points by column, and which columns lie around each: a row of adjacent columns is one run of points."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import CellGrid, rows_by_cell, sort_by_cell
from lidar_buildings.core.neighbours.windows import first_from

#: Columns at the very reach count as within, whatever rounding makes of it.
SLACK = 1e-9
#: Up to so many places a column are looked up in a table, else walked along; the result is the same.
MAX_PLACES = 16


@dataclass(frozen=True, eq=False)
class Columns:
    """Points column by column: the same sequence whatever the order of the rows if made by `by_column`."""

    points: NDArray[np.float64]  #: the points column by column [m], shape (n_points, 3)
    rows: NDArray[np.intp]  #: the input row of each, shape (n_points,)
    #: Column k holds the points first[k] to first[k + 1] (exclusive); none only after `select`, shape
    #: (n_columns + 1,).
    first: NDArray[np.int64]
    numbers: NDArray[np.int64]  #: where the columns stand, row by row from the south-west, shape (n_columns,)
    row_length: int  #: by how much the number of a column's northern neighbour is higher
    size: float  #: side of a column [m]
    _shared: dict[str, NDArray[np.int32]] = field(default_factory=dict)

    @property
    def column(self) -> NDArray[np.int64]:
        """The column of each point."""
        return np.repeat(np.arange(len(self.numbers)), np.diff(self.first))

    @property
    def places(self) -> NDArray[np.int32]:
        """Row and place in it of each column, from the south-west; shape (n_columns, 2)."""
        if "places" not in self._shared:
            places = np.column_stack(np.divmod(self.numbers, self.row_length))
            self._shared["places"] = places.astype(np.int32)
        return self._shared["places"]

    @property
    def _before(self) -> NDArray[np.int32]:
        """How many columns stand before each place and after the last; empty if places are too many."""
        if "before" not in self._shared:
            n, last = len(self.numbers), int(self.numbers[-1]) if len(self.numbers) else 0
            before = np.zeros(last + 2 if last < MAX_PLACES * n else 0, dtype=np.int32)
            if len(before):
                before[self.numbers + 1] = 1
                np.cumsum(before, out=before)
            self._shared["before"] = before
        return self._shared["before"]

    def select(self, kept: NDArray[np.bool_]) -> Columns:
        """Return some of the points in the same columns; their `rows` are positions among these points."""
        rows = np.flatnonzero(kept)
        return replace(self, points=self.points.take(rows, axis=0), rows=rows, first=self.first_of(kept))

    def holding(self, wanted: NDArray[np.bool_]) -> NDArray[np.intp]:
        """Return the columns with wanted points, rising."""
        return np.flatnonzero(np.diff(self.first_of(wanted)))

    def first_of(self, kept: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Return where the columns of `select` begin."""
        before = np.zeros(len(kept) + 1, dtype=np.int32)
        before[1:] = kept  # numpy sums truth values several times as slowly
        return np.cumsum(before, out=before)[self.first].astype(np.int64)

    def around(
        self, reach: float, asking: NDArray[np.intp] | None = None, *, north: bool = False
    ) -> NDArray[np.int32]:
        """
        Return the runs of columns within reach of any place in each column, row by row from the south.

        `reach` is in plan [m]; `asking` are columns, rising, all if not given; with `north` the rows south of
        each column's own are left out. Returned are each run's first column and the one after its last,
        (n_columns, n_rows, 2), equal where it is empty. Columns without points are left out, those just
        beyond the reach are not.
        """
        steps = math.ceil(reach / self.size - SLACK)
        across = np.maximum(abs(np.arange(-steps, steps + 1)) - 1, 0) * self.size
        half = np.ceil(np.sqrt(np.maximum(reach**2 - across**2, 0.0)) / self.size - SLACK)
        own = self.numbers if asking is None else self.numbers[asking]
        south = 0 if north else steps
        runs = np.empty((len(own), 1 + steps + south, 2), dtype=np.int32)
        half = half[steps - south :].astype(np.int64)
        _find_runs(own, self.numbers, self._before, self.row_length, half, south, runs)
        return runs


def by_column(points: NDArray[np.float64], size: float) -> Columns:
    """Sort points into square columns of a side [m], which is doubled for an enormous extent; by z, x, y."""
    return _of_grid(sort_by_cell(points, size))


def gathered(points: NDArray[np.float64], size: float) -> Columns:
    """Do so without sorting the points of a column, which keep the order given: half the time."""
    return _of_grid(rows_by_cell(points, size))


def _of_grid(grid: CellGrid) -> Columns:
    return Columns(grid.points, grid.rows, grid.first, grid.numbers, grid.n_columns, grid.size)


@kernel
def _find_runs(own, numbers, before, row_length, half, south, runs):  # type: ignore[no-untyped-def]
    """Find the runs of one column after the other; see `Columns.around`."""
    n, last = len(numbers), len(before) - 2
    begin, end = np.zeros((2, len(half)), dtype=np.int64)
    for row in range(len(half)):
        begin[row] = first_from(numbers, own[0] + (row - south) * row_length - half[row]) if len(own) else 0
    start = 0
    for k in range(len(own)):
        # That of the column before as a rule: a division for each would take longer than all else.
        while own[k] >= start + row_length:
            start = own[k] // row_length * row_length
        place = own[k] - start
        for row in range(len(half)):
            middle = own[k] + (row - south) * row_length
            west, east = middle - min(half[row], place), middle + min(half[row], row_length - 1 - place)
            if last >= 0:
                runs[k, row, 0] = before[min(max(west, 0), last + 1)]
                runs[k, row, 1] = before[min(max(east, -1), last) + 1]
                continue
            while begin[row] < n and numbers[begin[row]] < west:
                begin[row] += 1
            end[row] = max(begin[row], end[row])
            while end[row] < n and numbers[end[row]] <= east:
                end[row] += 1
            runs[k, row, 0], runs[k, row, 1] = begin[row], end[row]
