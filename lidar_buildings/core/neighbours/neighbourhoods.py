"""Neighbours within a radius, from a grid of columns whose points are sorted by elevation."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.point_array import checked_points
from lidar_buildings.core.neighbours.cell_grid import CellGrid, sort_by_cell
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.neighbours.windows import first_windows, move_windows, z_range


def build_grid(points: ArrayLike, size: float) -> CellGrid:
    """
    Sort points into square columns as `sort_by_cell`, and list the columns beside each.

    `size`, their side [m], is the largest radius to be asked for; it is doubled while the extent would need
    too many columns to number. Only occupied ones take memory. ValueError if it is not positive, or `points`
    are of another shape or not finite.
    """
    points = checked_points(points)
    if not (np.isfinite(size) and size > 0):
        raise ValueError(f"size = {size!r}: must be a positive length [m]")
    grid = sort_by_cell(points, float(size))
    cell = np.repeat(np.arange(len(grid.numbers)), np.diff(grid.first))
    adjacent = np.empty((len(grid.numbers), 9), dtype=np.int64)
    for_row_blocks(lambda a, b: _list_adjacent(grid.numbers, grid.n_columns, adjacent, a, b), len(adjacent))
    return grid._replace(cell=cell, adjacent=adjacent)


@kernel
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


@kernel
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
