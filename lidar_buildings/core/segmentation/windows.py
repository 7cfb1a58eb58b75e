"""
Chains of points that lie in each other's windows, found cell by cell in near-linear time.

"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.linked_sets import link, root

#: Cell numbers are kept within ± this, so that they fit an integer whatever the coordinates are.
_MAX_CELL = 2.0**40


def chain_windows(xy: NDArray[np.float64], reach: tuple[float, float]) -> tuple[NDArray[np.int64], int]:
    """
    Number the connected components of points that lie in each other's windows.

    Two points are linked if they differ by no more than `reach` in x and in y. Points are sorted into cells
    as large as the reach: a cell's points are all linked, and two neighbouring cells are joined by comparing
    their extreme points, so that no pairs have to be listed however dense the cloud is.

    Parameters
    ----------
    xy : ndarray of shape (n_points, 2)
        In any order [m].
    reach : tuple of two float
        Half the window's sides along x and y [m], > 0.

    Returns
    -------
    component : ndarray of int64, shape (n_points,)
        From 0; which number a component gets depends on the order of points, what belongs together does not.
    n_components : int
        Number of components.

    """
    if not len(xy):
        return np.zeros(0, dtype=np.int64), 0
    cells = np.clip(np.floor(xy / np.asarray(reach)), -_MAX_CELL, _MAX_CELL).astype(np.int64)
    order = np.lexsort((xy[:, 0], cells[:, 0], cells[:, 1]))
    x, y = np.ascontiguousarray(xy[order].T)
    column, row = np.ascontiguousarray(cells[order].T)
    is_first = np.ones(len(xy), dtype=bool)
    is_first[1:] = (np.diff(column) != 0) | (np.diff(row) != 0)
    first = np.append(np.flatnonzero(is_first), len(xy))
    root = _join_cells(x, y, first, column[first[:-1]], row[first[:-1]], reach[0], reach[1])
    roots, number = np.unique(root, return_inverse=True)
    component = np.empty(len(xy), dtype=np.int64)
    component[order] = np.repeat(number, np.diff(first))
    return component, len(roots)


@njit(cache=True, nogil=True)
def _join_cells(x, y, first, column, row, reach_x, reach_y):  # type: ignore[no-untyped-def]
    """
    Return every cell's root cell; cells are in row-major order, a cell's points by rising x.

    """
    n = len(column)
    parent = np.arange(n)
    above = 0
    for cell in range(n):
        is_next = cell + 1 < n and row[cell + 1] == row[cell] and column[cell + 1] == column[cell] + 1
        # Neighbours in a row hold points of the same height: only x decides.
        if is_next and x[first[cell + 1]] - x[first[cell + 1] - 1] <= reach_x:
            link(parent, cell, cell + 1)
        while above < n and (
            row[above] <= row[cell] or (row[above] == row[cell] + 1 and column[above] < column[cell] - 1)
        ):
            above += 1
        other = above
        while other < n and row[other] == row[cell] + 1 and column[other] <= column[cell] + 1:
            if root(parent, cell) != root(parent, other) and _linked_upwards(
                x, y, first, cell, other, column[other] - column[cell], reach_x, reach_y
            ):
                link(parent, cell, other)
            other += 1
    return np.array([root(parent, cell) for cell in range(n)])


@njit(cache=True, nogil=True)
def _linked_upwards(x, y, first, lower, upper, step, reach_x, reach_y):  # type: ignore[no-untyped-def]
    """
    Whether a point of the cell `lower` and one of the cell `upper`, one row higher, are linked.

    `step` is the difference of their columns, −1 to 1. Both cells are swept once from the side on which they
    face each other: the lower cell's points within reach in x only become more, so their highest y suffices.

    """
    i, last_i, j, last_j = first[lower], first[lower + 1], first[upper], first[upper + 1]
    if step == 0:
        return y[j:last_j].min() - y[i:last_i].max() <= reach_y
    highest = -np.inf
    if step > 0:
        i = last_i - 1
        for j in range(last_j - 1, first[upper] - 1, -1):
            while i >= first[lower] and x[j] - x[i] <= reach_x:
                highest = max(highest, y[i])
                i -= 1
            if y[j] - highest <= reach_y:
                return True
        return False
    for j in range(first[upper], last_j):
        while i < last_i and x[i] - x[j] <= reach_x:
            highest = max(highest, y[i])
            i += 1
        if y[j] - highest <= reach_y:
            return True
    return False
