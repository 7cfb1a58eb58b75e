"""
Roof points in square cells in plan, each with the cells round it.

"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.linked_sets import flatten, link
from lidar_buildings.core.point_order import sort_by_cell


class PlanCells(NamedTuple):
    """
    Points sorted by cell, the same sequence whatever the order of the rows.

    Attributes
    ----------
    points : ndarray of shape (n_points, 3)
        Sorted points [m].
    rows : ndarray of shape (n_points,), intp
        The input row of each.
    first : ndarray of int64, shape (n_cells + 1,)
        Occupied cell k holds the sorted points first[k] to first[k + 1] (exclusive).
    around : ndarray of int64, shape (n_cells, 9)
        The cell itself, then its eight neighbours; −1 where empty.

    """

    points: NDArray[np.float64]
    rows: NDArray[np.intp]
    first: NDArray[np.int64]
    around: NDArray[np.int64]


def plan_cells(points: NDArray[np.float64], size: float) -> PlanCells:
    """
    Sort points into cells at multiples of `size` [m] from the map origin.

    """
    cloud = sort_by_cell(points, size)
    around = np.full((len(cloud.numbers), 9), -1, dtype=np.int64)
    _look_around(cloud.numbers, cloud.n_columns, around)
    return PlanCells(cloud.points, cloud.rows, cloud.first, around)


def roofs_in_plan(cells: PlanCells) -> NDArray[np.int64]:
    """
    Number roofs from 0, per input row: points in cells that touch, be it at a corner, are of one.

    """
    parent = np.arange(len(cells.around))
    _link_neighbours(cells.around, parent)
    numbers = np.unique(parent, return_inverse=True)[1].reshape(-1)
    roof = np.empty(len(cells.points), dtype=np.int64)
    roof[cells.rows] = np.repeat(numbers, np.diff(cells.first))
    return roof


@njit(cache=True, nogil=True)
def _look_around(numbers, n_columns, around):  # type: ignore[no-untyped-def]
    """
    Fill `around` from rising cell numbers; `n_columns` of them make a row.

    """
    begin = np.zeros(3, dtype=np.int64)
    for k in range(len(numbers)):
        around[k, 0] = k
        column = numbers[k] % n_columns
        slot = 1
        for row in range(3):
            beside = numbers[k] + (row - 1) * n_columns
            while begin[row] < len(numbers) and numbers[begin[row]] < beside - 1:
                begin[row] += 1
            other = begin[row]
            while other < len(numbers) and numbers[other] <= beside + 1:
                # The first cell of a row follows the last one of the row before, far from it.
                if other != k and abs(numbers[other] % n_columns - column) <= 1:
                    around[k, slot] = other
                    slot += 1
                other += 1


@njit(cache=True, nogil=True)
def _link_neighbours(around, parent):  # type: ignore[no-untyped-def]
    """
    Link every cell to those round it.

    """
    for cell in range(len(parent)):
        for other in around[cell]:
            if other > cell:
                link(parent, cell, other)
    flatten(parent)
