"""
How steep the terrain is, roughly, before anything is known of it: enough to compare places some steps apart.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.neighbours.windows import cells_in_row

# Chosen with `bench.ground.noise`.
#: Cells along a block's side.
BLOCK_CELLS = 8
#: The share of a block's cells whose lowest points lie below the elevation taken for it.
LOW_SHARE = 0.25
#: Blocks on each side that take part in the plane through a block.
REACH = 2
#: With fewer blocks around than this a block counts as level.
MIN_BLOCKS = 6
#: What stands out less than this is terrain [m].
SMOOTH = 0.5
#: Times that the blocks standing out above the plane are left out; what stands out is halved each time.
MAX_PASSES = 6
#: Terrain is not taken to be steeper; rise over run.
MAX_GRADIENT = 1.0
#: Rows a block of work, each a small adjustment; wide margin, the result does not depend on it.
ROWS_A_BLOCK = 256


def terrain_gradient(
    lowest: NDArray[np.float64], counts: NDArray[np.bool_], cell: float
) -> NDArray[np.float64]:
    """
    Return the terrain's rise over run along x and y in each cell, shape (n_cells, 2).

    Each block of cells has the elevation below which a quarter of its cells reach. Through the blocks
    around, a plane is fitted from which those that stand out above, roofs and trees, are left out by and by.
    It counts as far as it explains how those that remain differ.

    Parameters
    ----------
    lowest : ndarray of shape (n_cells, 3)
        The lowest point of each cell, at most one a cell [m].
    counts : ndarray of shape (n_cells,), bool
        Which of them take part.
    cell : float
        Side of the cells [m].
    """
    blocks = sort_by_cell(lowest, BLOCK_CELLS * cell)
    nodes = _low_points(blocks.points, counts[blocks.rows], blocks.first)
    by_block = np.zeros((len(nodes), 2))
    for_row_blocks(
        lambda a, b: _fit_blocks(nodes, blocks.numbers, blocks.n_columns, by_block, a, b),
        len(nodes),
        ROWS_A_BLOCK,
    )
    gradient = np.empty((len(lowest), 2))
    gradient[blocks.rows] = np.repeat(by_block, np.diff(blocks.first), axis=0)
    return gradient


@njit(cache=True, nogil=True)
def _low_points(points, counts, first):  # type: ignore[no-untyped-def]
    """Return the point of each block below which the share of those that count lies; NaN if there is none."""
    nodes = np.full((len(first) - 1, 3), np.nan)
    for k in range(len(nodes)):
        n_points = 0
        for i in range(first[k], first[k + 1]):
            n_points += counts[i]
        left = min(int(LOW_SHARE * n_points) + (n_points > MIN_BLOCKS), n_points - 1)
        for i in range(first[k], first[k + 1]):
            if counts[i]:
                if left == 0:
                    for axis in range(3):
                        nodes[k, axis] = points[i, axis] - points[0, axis]
                left -= 1
    return nodes


@njit(cache=True, nogil=True)
def _fit_blocks(nodes, numbers, width, gradient, begin, end):  # type: ignore[no-untyped-def]
    around = np.empty(((2 * REACH + 1) ** 2, 3))
    kept = np.empty(len(around), dtype=np.bool_)
    for k in range(begin, end):
        n_around = 0
        row, column = numbers[k] // width, numbers[k] % width
        for beside in range(row - REACH, row + REACH + 1):
            start, stop = cells_in_row(numbers, width, beside, column, REACH)
            for j in range(start, stop):
                if not np.isnan(nodes[j, 2]):
                    for axis in range(3):
                        around[n_around, axis] = nodes[j, axis]
                    n_around += 1
        if n_around >= MIN_BLOCKS:
            for axis in range(3):
                origin = around[0, axis]
                for i in range(n_around):
                    around[i, axis] -= origin
            gradient[k, 0], gradient[k, 1] = _low_plane(around, n_around, kept)


@njit(cache=True, nogil=True)
def _low_plane(around, n, kept):  # type: ignore[no-untyped-def]
    n_kept, limit = 0, np.inf
    east, north, level = 0.0, 0.0, 0.0
    for number in range(MAX_PASSES + 1):
        n_fewer, highest = 0, 0.0
        for i in range(n):
            above = around[i, 2] - (level + east * around[i, 0] + north * around[i, 1])
            n_fewer += (number == 0 or kept[i]) and above <= limit
        if number > 0 and (n_fewer == n_kept or n_fewer < MIN_BLOCKS):
            break
        for i in range(n):
            above = around[i, 2] - (level + east * around[i, 0] + north * around[i, 1])
            kept[i] = (number == 0 or kept[i]) and above <= limit
        n_kept = n_fewer
        east, north, level = _plane(around, n, kept)
        for i in range(n):
            if kept[i]:
                above = around[i, 2] - (level + east * around[i, 0] + north * around[i, 1])
                highest = max(highest, above)
        limit = max(0.5 * highest, SMOOTH)
    explained = _explained(around, n, kept, n_kept, east, north)
    return explained * east, explained * north


@njit(cache=True, nogil=True)
def _explained(around, n, kept, n_kept, east, north):  # type: ignore[no-untyped-def]
    """Return which share of the variance of the kept points' elevations a slope explains, 0 to 1."""
    mean, mean_left = 0.0, 0.0
    for i in range(n):
        if kept[i]:
            mean += around[i, 2]
            mean_left += around[i, 2] - east * around[i, 0] - north * around[i, 1]
    mean, mean_left = mean / n_kept, mean_left / n_kept
    variance, left = 0.0, 0.0
    for i in range(n):
        if kept[i]:
            variance += (around[i, 2] - mean) ** 2
            left += (around[i, 2] - east * around[i, 0] - north * around[i, 1] - mean_left) ** 2
    variance, left = variance / n_kept, left / n_kept
    return max(0.0, 1.0 - left / variance) if variance > 0.0 else 0.0


@njit(cache=True, nogil=True)
def _plane(around, n_around, kept):  # type: ignore[no-untyped-def]
    """
    Return rise over run along x and y and the elevation at 0 of the least squares plane; level if undefined.
    """
    n, mean_x, mean_y, mean_z = 0, 0.0, 0.0, 0.0
    for i in range(n_around):
        if kept[i]:
            n += 1
            mean_x, mean_y, mean_z = mean_x + around[i, 0], mean_y + around[i, 1], mean_z + around[i, 2]
    if n < MIN_BLOCKS:
        return 0.0, 0.0, mean_z / max(n, 1)
    mean_x, mean_y, mean_z = mean_x / n, mean_y / n, mean_z / n
    xx, xy, yy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n_around):
        if kept[i]:
            x, y, z = around[i, 0] - mean_x, around[i, 1] - mean_y, around[i, 2] - mean_z
            xx, xy, yy, xz, yz = xx + x * x, xy + x * y, yy + y * y, xz + x * z, yz + y * z
    area = xx * yy - xy * xy
    if area <= 1e-3 * xx * yy or area <= 0.0:
        return 0.0, 0.0, mean_z
    east = min(max((xz * yy - yz * xy) / area, -MAX_GRADIENT), MAX_GRADIENT)
    north = min(max((yz * xx - xz * xy) / area, -MAX_GRADIENT), MAX_GRADIENT)
    return east, north, mean_z - east * mean_x - north * mean_y
