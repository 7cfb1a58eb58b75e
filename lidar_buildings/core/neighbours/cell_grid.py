"""Points by cell: neighbours together, whatever the order of the rows."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.neighbours.few_rows import rows_by_group
from lidar_buildings.core.neighbours.parallel import for_row_blocks

#: Largest number of cells that a row-by-column number may count: an eighth of what int64 holds; and of rows,
#: and of columns: half of what int32 holds.
MAX_CELLS, MAX_ROWS = 2.0**60, 2.0**30
#: Up to so many cells a point are counted one by one, else numbers are sorted; the result is the same.
MAX_COUNTED_CELLS = 8
#: Gaps in a raster without any point are shortened to so many cells; cells are doubled beyond so many.
LONGEST_GAP, MAX_RASTER_CELLS = 8, 4_000_000
#: Cells a block of work: some ten thousand points.
CELLS_A_BLOCK = 2048
#: Cells at the very reach count as within, whatever rounding makes of it.
SLACK = 1e-9
#: Steps of the sort within a cell (Ciura 2001, each further one 2.25 times the one before).
SHELL_STEPS = (85_764, 38_117, 16_941, 7_529, 3_346, 1_487, 661, 294, 132, 57, 23, 10, 4, 1)


class CellGrid(NamedTuple):
    """Points in square cells that start at multiples of their size from (0, 0), cell by cell."""

    points: NDArray[np.float64]  #: the points cell by cell [m], shape (n_points, 2 or 3)
    rows: NDArray[np.intp]  #: the input row of each, shape (n_points,)
    numbers: NDArray[np.int64]  #: where the cells stand, rising, row by row from the south-west, (n_cells,)
    #: Cell k holds the points first[k] to first[k + 1] (exclusive); none only after `select`, (n_cells + 1,).
    first: NDArray[np.int64]
    n_columns: int  #: by how much the number of a cell's northern neighbour is higher
    size: float  #: side of a cell [m]

    @property
    def cell(self) -> NDArray[np.int64]:
        """The cell of each point."""
        return np.repeat(np.arange(len(self.numbers)), np.diff(self.first))

    @property
    def places(self) -> NDArray[np.int32]:
        """Row and place in it of each cell, from the south-west; shape (n_cells, 2)."""
        return np.column_stack(np.divmod(self.numbers, self.n_columns)).astype(np.int32)

    def select(self, kept: NDArray[np.bool_]) -> CellGrid:
        """Return some of the points in the same cells; their `rows` are positions among these points."""
        rows = np.flatnonzero(kept)
        return self._replace(points=self.points.take(rows, axis=0), rows=rows, first=self.first_of(kept))

    def holding(self, wanted: NDArray[np.bool_]) -> NDArray[np.intp]:
        """Return the cells with wanted points, rising."""
        return np.flatnonzero(np.diff(self.first_of(wanted)))

    def first_of(self, kept: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Return where the cells of `select` begin."""
        before = np.zeros(len(kept) + 1, dtype=np.int32)
        before[1:] = kept  # numpy sums truth values several times as slowly
        return np.cumsum(before, out=before)[self.first].astype(np.int64)

    def around(
        self, reach: float, asking: NDArray[np.intp] | None = None, *, north: bool = False
    ) -> NDArray[np.int32]:
        """
        Return the runs of cells within reach of any place in each cell, row by row from the south.

        `reach` is in plan [m]; `asking` are cells, rising, all if not given; with `north` the rows south of
        each cell's own are left out. Returned are each run's first cell and the one after its last,
        (n_cells, n_rows, 2), equal where it is empty. Cells just beyond the reach may be among them.
        """
        steps = math.ceil(reach / self.size - SLACK)
        across = np.maximum(abs(np.arange(-steps, steps + 1)) - 1, 0) * self.size
        half = np.ceil(np.sqrt(np.maximum(reach**2 - across**2, 0.0)) / self.size - SLACK)
        own = self.numbers if asking is None else self.numbers[asking]
        south = 0 if north else steps
        runs = np.empty((len(own), 1 + steps + south, 2), dtype=np.int32)
        half = half[steps - south :].astype(np.int64)
        _find_runs(own, self.numbers, self.n_columns, half, south, runs)
        return runs


def rows_by_cell(points: NDArray[np.float64], cell: float) -> CellGrid:
    """
    Gather points cell by cell, those of one cell in the order given; only x and y decide.

    The side of cells [m] is doubled until an enormous extent can be numbered.
    """
    numbers, n_columns, cell = _numbered(points, cell)
    rows, numbers, first = _rows_by_number(numbers)
    return CellGrid(np.take(points, rows, axis=0), rows, numbers, first, n_columns, cell)


def sort_by_cell(points: NDArray[np.float64], cell: float) -> CellGrid:
    """
    Sort points by cell, and by z, x, y within each: the same sequence whatever the rows' order.

    Cells are counted, not compared: the time is linear in the number of points, which are C-contiguous. The
    side of cells [m] is doubled until an enormous extent can be numbered.
    """
    numbers, n_columns, cell = _numbered(points, cell)
    rows, numbers, first = _rows_by_number(numbers)
    ordered = np.empty_like(points)
    for_row_blocks(lambda a, b: _fill_cells(points, rows, ordered, first, a, b), len(numbers), CELLS_A_BLOCK)
    return CellGrid(ordered, rows, numbers, first, n_columns, cell)


def lowest_of_cells(grid: CellGrid, kept: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the lowest kept point of each cell of a sorted grid, where there is one, cell by cell."""
    rows = np.flatnonzero(kept)
    place = np.searchsorted(rows, grid.first)
    return rows[place[:-1][place[:-1] < place[1:]]]


def in_rows_order(grid: CellGrid, values: NDArray[Any]) -> NDArray[Any]:
    """Return one value per point of the grid in the order of the input rows."""
    unsorted = np.empty_like(values)
    unsorted[grid.rows] = values
    return unsorted


def cell_numbers(points: NDArray[np.float64], cell: float) -> NDArray[np.int64]:
    """
    Number the points' cells row by row from the south-west; cells start at multiples of `cell` from (0, 0).

    The side of cells [m] is doubled until an enormous extent can be numbered.
    """
    return _numbered(points, cell)[0]


def cell_order(points: NDArray[np.float64], cell: float) -> NDArray[np.intp]:
    """Return the rows cell by cell, so that consecutive points are near each other."""
    return _rows_by_number(cell_numbers(points, cell))[0]


def lowest_per_cell(points: NDArray[np.float64], cell: float) -> NDArray[np.intp]:
    """
    Return the row of the lowest point of every occupied cell, cell by cell from the south-west.

    Ties are broken by x, then y, so that the same points come out whatever their order.
    """
    rows, _, first = _rows_by_number(cell_numbers(points, cell))
    return _lowest_of_runs(rows, first, np.ascontiguousarray(points))


def raster_cells(points: NDArray[np.float64], cell: float) -> tuple[NDArray[np.int64], tuple[int, int]]:
    """Return the cell of each point in a raster, row by row, and its shape; far points take no room."""
    while True:
        (rows, n_rows), (columns, n_columns) = (without_gaps(points[:, axis], cell) for axis in (1, 0))
        if n_rows * n_columns <= MAX_RASTER_CELLS:
            return rows * n_columns + columns, (n_rows, n_columns)
        cell *= 2.0


def without_gaps(coordinate: NDArray[np.float64], cell: float) -> tuple[NDArray[np.int64], int]:
    """Return in which row each coordinate lies, and how many rows there are, long gaps shortened."""
    taken, at = np.unique(np.floor(coordinate / cell), return_inverse=True)
    row = np.cumsum(np.minimum(np.diff(taken, prepend=taken[0]), LONGEST_GAP)).astype(np.int64)
    return row[at], int(row[-1]) + 1


@kernel
def mark_cells(points, cell, low_x, low_y, plan):  # type: ignore[no-untyped-def]
    """
    Mark which cells of a window hold points, whatever else it marks.

    `plan` is the window, shape (n_columns, n_rows), from column `low_x` and row `low_y` on; cells count from
    (0, 0).
    """
    for i in range(len(points)):
        x, y = np.floor(points[i, 0] / cell) - low_x, np.floor(points[i, 1] / cell) - low_y
        if 0 <= x < plan.shape[0] and 0 <= y < plan.shape[1]:
            plan[int(x), int(y)] = True


def _numbered(points: NDArray[np.float64], cell: float) -> tuple[NDArray[np.int64], int, float]:
    """Return the cells' numbers, the number of columns and the cells' side."""
    if len(points) == 0:
        return np.zeros(0, dtype=np.int64), 1, cell
    low, high = extent_of(points)[:, :2].tolist()
    while _are_too_many(_n_across(low[0], high[0], cell), _n_across(low[1], high[1], cell)):
        cell *= 2.0
    # Differences before the cast: a coordinate far from the origin would not fit an integer.
    west, south = math.floor(low[0] / cell), math.floor(low[1] / cell)
    n_columns = int(math.floor(high[0] / cell) - west) + 1
    numbers = np.empty(len(points), dtype=np.int64)
    start = (float(west), float(south))
    for_row_blocks(lambda a, b: _number(points, cell, start, n_columns, numbers, a, b), len(points))
    return numbers, n_columns, cell


def _are_too_many(n_columns: float, n_rows: float) -> bool:
    return n_columns * n_rows > MAX_CELLS or max(n_columns, n_rows) > MAX_ROWS


def _n_across(low: float, high: float, cell: float) -> float:
    # Differences of quotients do not overflow.
    return high / cell - low / cell + 2.0


@kernel
def _number(points, cell, start, n_columns, numbers, begin, end):  # type: ignore[no-untyped-def]
    for i in range(begin, end):
        column = np.int64(math.floor(points[i, 0] / cell) - start[0])
        row = np.int64(math.floor(points[i, 1] / cell) - start[1])
        numbers[i] = row * n_columns + column


def _rows_by_number(
    numbers: NDArray[np.int64],
) -> tuple[NDArray[np.intp], NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows by rising number, equal ones in the order given; the numbers; where each begins."""
    if int(numbers.max(initial=0)) < MAX_COUNTED_CELLS * (len(numbers) + 1024):
        rows, first = rows_by_group(numbers, int(numbers.max(initial=-1)) + 1)
        occupied = np.flatnonzero(first[1:] != first[:-1])
        return rows, occupied, np.append(first[occupied], len(rows))
    rows = np.argsort(numbers, kind="stable")
    in_order = numbers[rows]
    begins = np.flatnonzero(np.diff(in_order, prepend=-1))
    return rows, in_order[begins], np.append(begins, len(rows))


@kernel
def _fill_cells(points, rows, ordered, first, begin, end):  # type: ignore[no-untyped-def]
    """Sort the rows of the cells `begin` to `end` and copy their points into their places."""
    most = 0
    for k in range(begin, end):
        most = max(most, first[k + 1] - first[k])
    elevation = np.empty(most)
    for k in range(begin, end):
        _sort_cell(points, rows[first[k] : first[k + 1]], elevation)
    for i in range(first[begin], first[end]):
        for axis in range(3):
            ordered[i, axis] = points[rows[i], axis]


@kernel
def _sort_cell(points, rows, elevation):  # type: ignore[no-untyped-def]
    """Sort a cell's rows by their points' z, x, y (Shell 1959); `elevation` is room for as many numbers."""
    for i in range(len(rows)):
        elevation[i] = points[rows[i], 2]
    for step in SHELL_STEPS:
        for i in range(step, len(rows)):
            z, row = elevation[i], rows[i]
            j = i
            while j >= step and _comes_first(points, z, row, elevation[j - step], rows[j - step]):
                elevation[j], rows[j] = elevation[j - step], rows[j - step]
                j -= step
            elevation[j], rows[j] = z, row


@kernel
def _comes_first(points, z, row, other_z, other_row):  # type: ignore[no-untyped-def]
    """Whether a row's point, of elevation z, comes before another's by z, x, y."""
    if z != other_z:
        return z < other_z
    for axis in range(2):
        if points[row, axis] != points[other_row, axis]:
            return points[row, axis] < points[other_row, axis]
    return False


@kernel
def _lowest_of_runs(rows, first, points):  # type: ignore[no-untyped-def]
    lowest = np.empty(len(first) - 1, dtype=np.intp)
    for k in range(len(lowest)):
        best = rows[first[k]]
        for i in range(first[k] + 1, first[k + 1]):
            if _comes_first(points, points[rows[i], 2], rows[i], points[best, 2], best):
                best = rows[i]
        lowest[k] = best
    return lowest


@kernel
def _find_runs(own, numbers, n_columns, half, south, runs):  # type: ignore[no-untyped-def]
    """Find the runs of one row after the other, each cell's from that of the cell before."""
    if len(own) == 0:
        return
    for row in range(len(half)):
        begin = first_from(numbers, own[0] + (row - south) * n_columns - half[row])
        end, start = begin, 0
        for k in range(len(own)):
            # That of the cell before as a rule: a division for each would take longer than all else.
            while own[k] >= start + n_columns:
                start = own[k] // n_columns * n_columns
            place, middle = own[k] - start, own[k] + (row - south) * n_columns
            west, east = middle - min(half[row], place), middle + min(half[row], n_columns - 1 - place)
            while begin < len(numbers) and numbers[begin] < west:
                begin += 1
            end = max(begin, end)
            while end < len(numbers) and numbers[end] <= east:
                end += 1
            runs[k, row, 0], runs[k, row, 1] = begin, end


@kernel
def first_from(numbers, least):  # type: ignore[no-untyped-def]
    """Return where rising numbers are no longer less, as np.searchsorted, which takes longer to compile."""
    begin, end = 0, len(numbers)
    while begin < end:
        middle = (begin + end) // 2
        if numbers[middle] < least:
            begin = middle + 1
        else:
            end = middle
    return begin


@inner_kernel
def cells_in_row(numbers, n_columns, row, column, reach):  # type: ignore[no-untyped-def]
    """
    Return where the run of a row's occupied cells begins and ends that lie at most `reach` from a column.

    Row and column, counted from the first cell's as `numbers` are, may lie beyond the grid.
    """
    west, east = max(column - reach, 0), min(column + reach, n_columns - 1)
    begin = first_from(numbers, row * n_columns + west)
    return begin, first_from(numbers, row * n_columns + east + 1)
