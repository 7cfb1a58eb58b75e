"""
Neighbours within a radius, from a grid of columns whose points are sorted by elevation.

"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.point_array import checked_points
from lidar_buildings.core.row_blocks import for_row_blocks

#: Largest number of columns that a key may count.
MAX_COLUMNS = 2.0**60


class CellGrid(NamedTuple):
    """
    Points sorted by column, and by z, x, y within each: the same sequence whatever the rows' order.

    Attributes
    ----------
    points : ndarray of shape (n_points, 3)
        Sorted points [m].
    rows : ndarray of int64, shape (n_points,)
        The input row of each sorted point.
    cell : ndarray of int64, shape (n_points,)
        The occupied column that each sorted point lies in.
    first : ndarray of int64, shape (n_cells + 1,)
        Column c holds the sorted points first[c] to first[c + 1] (exclusive).
    adjacent : ndarray of int64, shape (n_cells, 9)
        The column itself and its eight neighbours, −1 where empty.
    size : float
        Side of a column [m]; no neighbour within it is farther than one column away.

    """

    points: NDArray[np.float64]
    rows: NDArray[np.int64]
    cell: NDArray[np.int64]
    first: NDArray[np.int64]
    adjacent: NDArray[np.int64]
    size: float


def build_grid(points: ArrayLike, size: float) -> CellGrid:
    """
    Sort points into square columns at multiples of `size` from the map origin.

    Parameters
    ----------
    points : array_like of shape (n_points, 3)
        In any order [m].
    size : float
        Side of a column [m], > 0: the largest radius to be asked for. It is doubled while the extent would
        need too many columns to number.

    Returns
    -------
    CellGrid
        Only occupied columns take memory, however far apart the points are.

    Raises
    ------
    ValueError
        If `points` has another shape or is not finite, or `size` is not positive.

    """
    points = checked_points(points)
    if not (np.isfinite(size) and size > 0):
        raise ValueError(f"size = {size!r}: must be a positive length [m]")
    key, size, n_rows = _column_keys(points, float(size))
    order = np.lexsort((points[:, 1], points[:, 0], points[:, 2], key))
    sorted_key = key[order]
    begins = np.flatnonzero(np.diff(sorted_key, prepend=-1))
    first = np.append(begins, len(order))
    cell = np.repeat(np.arange(len(begins)), np.diff(first))
    adjacent = _adjacent_columns(sorted_key[begins], n_rows)
    return CellGrid(points[order], order, cell, first, adjacent, size)


def radius_neighbours(
    points: ArrayLike, radius: float, *, in_plan: bool = False
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    List the neighbours of every point within a radius, itself included.

    Parameters
    ----------
    points : array_like of shape (n_points, 3)
        In any order [m].
    radius : float
        Inclusive [m], > 0.
    in_plan : bool
        Whether z is left out of the distance.

    Returns
    -------
    offsets : ndarray of int64, shape (n_points + 1,)
        The neighbours of row i are ``neighbours[offsets[i]:offsets[i + 1]]``.
    neighbours : ndarray of int64
        Input rows, in the grid's order.

    Notes
    -----
    Two passes, the first one counts. Memory grows with the number of neighbours.

    """
    grid = build_grid(points, radius)
    counts = np.zeros(len(grid.points), dtype=np.int64)
    none = np.zeros(0, dtype=np.int64)
    for_row_blocks(lambda a, b: _count_or_list(grid, radius, in_plan, counts, none, a, b), len(counts))
    offsets = np.concatenate([[0], np.cumsum(counts)])
    neighbours = np.empty(offsets[-1], dtype=np.int64)
    for_row_blocks(lambda a, b: _count_or_list(grid, radius, in_plan, offsets, neighbours, a, b), len(counts))
    return offsets, neighbours


@njit(cache=True, nogil=True)
def z_range(z, first, last, low, high):  # type: ignore[no-untyped-def]
    """
    Return the part (start, stop) of z[first:last], sorted, that lies within low to high, both inclusive.

    """
    if low == -np.inf and high == np.inf:
        return first, last
    start, end = first, last
    while start < end:
        middle = (start + end) // 2
        if z[middle] < low:
            start = middle + 1
        else:
            end = middle
    stop, end = start, last
    while stop < end:
        middle = (stop + end) // 2
        if z[middle] <= high:
            stop = middle + 1
        else:
            end = middle
    return start, stop


@njit(cache=True, nogil=True)
def neighbours_of(grid, cell, x, y, z, radius, in_plan, near):  # type: ignore[no-untyped-def]
    """
    Write the sorted points within a radius of a position in an occupied column to `near`; return how many.

    `near` holds as many numbers as there are points; what is beyond the count is not touched or is rubbish.

    """
    points = grid.points
    reach = np.inf if in_plan else radius
    upright = 0.0 if in_plan else 1.0
    found = 0
    for c in grid.adjacent[cell]:
        if c < 0:
            continue
        start, stop = z_range(points[:, 2], grid.first[c], grid.first[c + 1], z - reach, z + reach)
        for j in range(start, stop):
            dx, dy, dz = points[j, 0] - x, points[j, 1] - y, upright * (points[j, 2] - z)
            if dx * dx + dy * dy + dz * dz <= radius * radius:
                near[found] = j
                found += 1
    return found


def _column_keys(points: NDArray[np.float64], size: float) -> tuple[NDArray[np.int64], float, int]:
    """
    Number the columns, an empty one left on every side; return the keys, the side and the keys per column.

    """
    if len(points) == 0:
        return np.zeros(0, dtype=np.int64), size, 0
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    # The second condition keeps cell numbers within int64 where the origin is very far away.
    while np.prod((high - low) / size + 4.0) > MAX_COLUMNS or np.abs([low, high]).max() / size > MAX_COLUMNS:
        size *= 2.0
    column, row = np.floor(points[:, :2] / size).astype(np.int64).T
    n_rows = int(row.max() - row.min()) + 3
    return (column - column.min() + 1) * n_rows + (row - row.min() + 1), size, n_rows


def _adjacent_columns(keys: NDArray[np.int64], n_rows: int) -> NDArray[np.int64]:
    """
    Look up each occupied column's own number and those of its eight neighbours.

    """
    if len(keys) == 0:
        return np.zeros((0, 9), dtype=np.int64)
    steps = (np.arange(-1, 2)[:, None] * n_rows + np.arange(-1, 2)).ravel()
    wanted = keys[:, None] + steps
    found = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[found] == wanted, found, -1)


@njit(cache=True, nogil=True)
def _count_or_list(grid, radius, in_plan, slots, neighbours, begin, end):  # type: ignore[no-untyped-def]
    """
    Write the neighbour counts of sorted points begin to end to slots, or list them from slots on.

    """
    near = np.empty(len(grid.points), dtype=np.int64)
    for i in range(begin, end):
        x, y, z = grid.points[i]
        found = neighbours_of(grid, grid.cell[i], x, y, z, radius, in_plan, near)
        row = grid.rows[i]
        if len(neighbours) == 0:
            slots[row] = found
            continue
        for k in range(found):
            neighbours[slots[row] + k] = grid.rows[near[k]]
