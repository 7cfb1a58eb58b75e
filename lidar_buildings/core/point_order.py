"""
Points by cell: neighbours together, whatever the order of the rows.

"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

#: Largest number of cells that a row-by-column number may count.
MAX_CELLS = 2.0**60


def cell_numbers(points: NDArray[np.float64], cell: float) -> NDArray[np.int64]:
    """
    Number the points' cells row by row from the south-west; cells start at multiples of `cell` from (0, 0).

    Parameters
    ----------
    points : ndarray of shape (n_points, 2 or more)
        Only x and y are looked at [m].
    cell : float
        Side of a cell [m]; doubled until an enormous extent can be numbered.

    """
    return numbered_cells(points, cell)[0]


def numbered_cells(points: NDArray[np.float64], cell: float) -> tuple[NDArray[np.int64], int]:
    """
    Return the numbers of `cell_numbers`, and by how much a cell's northern neighbour's number is higher.

    """
    if len(points) == 0:
        return np.zeros(0, dtype=np.int64), 1
    x, y = points[:, 0], points[:, 1]
    width, height = float(np.ptp(x)), float(np.ptp(y))
    while (width / cell + 2.0) * (height / cell + 2.0) > MAX_CELLS:
        cell *= 2.0
    # Differences before the cast: a coordinate far from the origin would not fit an integer.
    column, row = np.floor(x / cell), np.floor(y / cell)
    column, row = (column - column.min()).astype(np.int64), (row - row.min()).astype(np.int64)
    n_columns = int(column.max()) + 1
    return row * n_columns + column, n_columns


def cell_order(points: NDArray[np.float64], cell: float) -> NDArray[np.intp]:
    """
    Return the rows cell by cell, so that consecutive points are near each other.

    """
    return np.argsort(cell_numbers(points, cell), kind="stable")


def lowest_per_cell(points: NDArray[np.float64], cell: float) -> NDArray[np.intp]:
    """
    Return the row of the lowest point of every occupied cell, cell by cell from the south-west.

    Ties are broken by x, then y, so that the same points come out whatever their order.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In any order [m].
    cell : float
        Side of a cell [m].

    """
    number = cell_numbers(points, cell)
    order = np.argsort(number, kind="stable")
    return _lowest_of_runs(order, number[order], np.ascontiguousarray(points))


@njit(cache=True, nogil=True)
def _lowest_of_runs(order, sorted_number, points):  # type: ignore[no-untyped-def]
    """
    Return the lowest point of each run of equal numbers.

    """
    lowest = np.empty(len(order), dtype=np.intp)
    n_runs = 0
    for i in range(len(order)):
        if i == 0 or sorted_number[i] != sorted_number[i - 1]:
            lowest[n_runs] = order[i]
            n_runs += 1
        elif _lower(points, order[i], lowest[n_runs - 1]):
            lowest[n_runs - 1] = order[i]
    return lowest[:n_runs].copy()


@njit(cache=True, nogil=True)
def _lower(points, i, j):  # type: ignore[no-untyped-def]
    """
    Whether point i lies lower than point j, ties broken by x, then y.

    """
    for axis in (2, 0, 1):
        if points[i, axis] != points[j, axis]:
            return points[i, axis] < points[j, axis]
    return False
