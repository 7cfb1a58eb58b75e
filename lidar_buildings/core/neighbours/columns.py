"""Points by column, and which columns lie around each: a row of adjacent columns is one run of points."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.neighbours.cell_grid import sort_by_cell

#: Columns at the very reach count as within, whatever rounding makes of it.
SLACK = 1e-9
#: Runs of columns so many steps away are kept for the next who asks; wider ones take more memory than time.
KEPT_STEPS = 2
#: Up to so many places a column are counted one by one, else walked along; the result is the same.
MAX_PLACES = 16


@dataclass(frozen=True, eq=False)
class Columns:
    """
    Points column by column, in each by z, x, y: the same sequence whatever the order of the rows.

    Attributes
    ----------
    points : ndarray of shape (n_points, 3)
        The points column by column [m].
    rows : ndarray of shape (n_points,), intp
        The input row of each.
    first : ndarray of shape (n_columns + 1,), int64
        Column k holds the points first[k] to first[k + 1] (exclusive); none only after `select`.
    numbers : ndarray of shape (n_columns,), int64
        Where the columns stand, row by row from the south-west.
    row_length : int
        By how much the number of a column's northern neighbour is higher.
    size : float
        Side of a column [m].
    """

    points: NDArray[np.float64]
    rows: NDArray[np.intp]
    first: NDArray[np.int64]
    numbers: NDArray[np.int64]
    row_length: int
    size: float
    _shared: dict[str, NDArray[np.int32]] = field(default_factory=dict)

    @cached_property
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

    def select(self, kept: NDArray[np.bool_]) -> Columns:
        """Return some of the points in the same columns; their `rows` are positions among these points."""
        chosen = np.flatnonzero(kept)
        return replace(self, points=self.points.take(chosen, axis=0), rows=chosen, first=self.first_of(kept))

    def first_of(self, kept: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Return where the columns of `select` begin."""
        first = np.empty_like(self.first)
        _count_kept(kept, self.first, first)
        return first

    def around(self, reach: float, asking: NDArray[np.intp] | None = None) -> NDArray[np.int32]:
        """
        Return the runs of columns within reach of any place in each column, row by row from the south.

        Parameters
        ----------
        reach : float
            In plan [m].
        asking : ndarray of intp, shape (n_asking,), optional
            For which columns, rising; for all if not given.

        Returns
        -------
        ndarray of int32, shape (n_columns, n_rows, 2)
            Each run's first column and the one after its last; equal where it is empty. Columns without
            points are left out, those just beyond the reach are not.
        """
        steps = math.ceil(reach / self.size - SLACK)
        key = repr(float(reach))
        if asking is None and key in self._shared:
            return self._shared[key]
        across = np.maximum(abs(np.arange(-steps, steps + 1)) - 1, 0) * self.size
        half = np.ceil(np.sqrt(np.maximum(reach**2 - across**2, 0.0)) / self.size - SLACK)
        own = self.numbers if asking is None else self.numbers[asking]
        runs: NDArray[np.int32] = _find_runs(own, self.numbers, self.row_length, half.astype(np.int64))
        if asking is None and steps <= KEPT_STEPS:
            self._shared[key] = runs
        return runs


def by_column(points: NDArray[np.float64], size: float) -> Columns:
    """Sort points into square columns of a side [m], which is doubled for an enormous extent."""
    grid = sort_by_cell(points, size)
    return Columns(grid.points, grid.rows, grid.first, grid.numbers, grid.n_columns, grid.size)


@kernel
def _count_kept(kept, first, first_kept):  # type: ignore[no-untyped-def]
    """Write where columns begin among the kept points."""
    n = 0
    for k in range(len(first) - 1):
        first_kept[k] = n
        for i in range(first[k], first[k + 1]):
            n += kept[i]
    first_kept[-1] = n


@kernel
def _find_runs(own, numbers, row_length, half):  # type: ignore[no-untyped-def]
    n = len(numbers)
    runs = np.zeros((len(own), len(half), 2), dtype=np.int32)
    last = numbers[-1] if n else 0
    if last < MAX_PLACES * n:
        _look_up_runs(own, numbers, row_length, half, runs)
        return runs
    for row in range(len(half)):
        begin, end, start = 0, 0, 0
        for k in range(len(own)):
            start, west, east = _span(own[k], start, row, row_length, half)
            while begin < n and numbers[begin] < west:
                begin += 1
            end = max(begin, end)
            while end < n and numbers[end] <= east:
                end += 1
            runs[k, row, 0], runs[k, row, 1] = begin, end
    return runs


@inner_kernel
def _look_up_runs(own, numbers, row_length, half, runs):  # type: ignore[no-untyped-def]
    """Find the runs of one column after the other, in a table of how many columns stand before each place."""
    last = numbers[-1]
    before = np.zeros(last + 2, dtype=np.int32)
    for number in numbers:
        before[number + 1] = 1
    for place in range(last + 1):
        before[place + 1] += before[place]
    start = 0
    for k in range(len(own)):
        for row in range(len(half)):
            start, west, east = _span(own[k], start, row, row_length, half)
            runs[k, row, 0] = before[min(max(west, 0), last + 1)]
            runs[k, row, 1] = before[min(max(east, -1), last) + 1]


@inner_kernel
def _span(number, start, row, row_length, half):  # type: ignore[no-untyped-def]
    """
    Return where a column's own row starts, and the first and the last place of a run beside it.

    `start` is that of the column before: a division for each would take longer than all else.
    """
    while number >= start + row_length:
        start = number // row_length * row_length
    place, middle = number - start, number + (row - len(half) // 2) * row_length
    return start, middle - min(half[row], place), middle + min(half[row], row_length - 1 - place)
