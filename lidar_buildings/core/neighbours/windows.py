"""
Windows of cells: what lies within reach of a cell, found once for all points of the cell.

Cells are numbered row by row, so a window is one run of occupied cells per row, and as the cell moves on from
number to number each run only ever moves forward.
"""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel


@kernel
def first_windows(numbers, n_columns, reach, cell):  # type: ignore[no-untyped-def]
    """
    Return the window of an occupied cell, for `move_windows` to start from.

    `numbers` are those of the occupied cells, int64, rising, by `n_columns` higher for a northern neighbour;
    `cell` is a position in them. The window extends `reach` cells on each side. Returned are the positions
    where each row's run begins and ends (exclusive), from south to north, int64 (2 reach + 1, 2).
    """
    windows = np.empty((2 * reach + 1, 2), dtype=np.int64)
    row, column = numbers[cell] // n_columns, numbers[cell] % n_columns
    for k in range(len(windows)):
        begin, end = cells_in_row(numbers, n_columns, row + k - reach, column, reach)
        windows[k, 0], windows[k, 1] = begin, end
    return windows


@kernel
def cells_in_row(numbers, n_columns, row, column, reach):  # type: ignore[no-untyped-def]
    """
    Return where the run of a row's occupied cells begins and ends that lie at most `reach` from a column.

    Row and column, counted from the first cell's as `numbers` are, may lie beyond the grid.
    """
    west, east = max(column - reach, 0), min(column + reach, n_columns - 1)
    begin = first_from(numbers, row * n_columns + west)
    return begin, first_from(numbers, row * n_columns + east + 1)


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


@kernel
def move_windows(numbers, n_columns, reach, cell, windows):  # type: ignore[no-untyped-def]
    """Move the window of an earlier cell to this one."""
    column = numbers[cell] % n_columns
    west, east = min(reach, column), min(reach, n_columns - 1 - column)
    for row in range(len(windows)):
        beside = numbers[cell] + (row - reach) * n_columns
        begin, end = windows[row]
        while begin < len(numbers) and numbers[begin] < beside - west:
            begin += 1
        end = max(begin, end)
        while end < len(numbers) and numbers[end] <= beside + east:
            end += 1
        windows[row, 0], windows[row, 1] = begin, end


@kernel
def z_range(z, first, last, low, high):  # type: ignore[no-untyped-def]
    """
    Return the part (start, stop) of z[first:last], sorted, that lies within low to high, both inclusive.
    """
    start, end = first, last
    if z[first] >= low:
        end = first
    while start < end:
        middle = (start + end) // 2
        if z[middle] < low:
            start = middle + 1
        else:
            end = middle
    stop, end = start, last
    if z[last - 1] <= high:
        stop = last
    while stop < end:
        middle = (stop + end) // 2
        if z[middle] <= high:
            stop = middle + 1
        else:
            end = middle
    return start, stop
