"""Neighbours within a radius, from a grid of columns whose points are sorted by elevation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.model.point_array import checked_points
from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.neighbours.windows import first_windows, move_windows, z_range


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
    cloud = sort_by_cell(points, float(size))
    cell = np.repeat(np.arange(len(cloud.numbers)), np.diff(cloud.first))
    adjacent = np.empty((len(cloud.numbers), 9), dtype=np.int64)
    for_row_blocks(
        lambda a, b: _list_adjacent(cloud.numbers, cloud.n_columns, adjacent, a, b), len(cloud.numbers)
    )
    return CellGrid(cloud.points, cloud.rows, cell, cloud.first, adjacent, cloud.size)


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


@njit(cache=True, nogil=True)
def _list_adjacent(numbers, n_columns, adjacent, begin, end):  # type: ignore[no-untyped-def]
    """Look up the columns begin to end themselves and their eight neighbours, row by row from the south."""
    windows = first_windows(numbers, n_columns, 1, begin)
    for k in range(begin, end):
        move_windows(numbers, n_columns, 1, k, windows)
        adjacent[k] = -1
        for row in range(3):
            west = numbers[k] + (row - 1) * n_columns - 1
            for c in range(windows[row, 0], windows[row, 1]):
                adjacent[k, 3 * row + numbers[c] - west] = c


@njit(cache=True, nogil=True)
def _count_or_list(grid, radius, in_plan, slots, neighbours, begin, end):  # type: ignore[no-untyped-def]
    """Write the neighbour counts of sorted points begin to end to slots, or list them from slots on."""
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
