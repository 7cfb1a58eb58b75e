"""
How steep the terrain is, roughly, before anything is known of it: enough to compare places some steps apart.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.cell_grid import CellGrid, sort_by_cell

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


def terrain_gradient(lowest: NDArray[np.float64], cell: float) -> NDArray[np.float64]:
    """
    Return the terrain's rise over run along x and y in each cell, shape (n_cells, 2), from its lowest point.

    Each block of cells has the elevation below which a quarter of its cells reach. Through the blocks around,
    a plane is fitted from which those that stand out above, roofs and trees, are left out by and by. It
    counts as far as it explains how those that remain differ.
    """
    blocks = sort_by_cell(lowest, BLOCK_CELLS * cell)
    n = np.diff(blocks.first)
    low = np.minimum((LOW_SHARE * n).astype(np.int64) + (n > MIN_BLOCKS), n - 1)
    nodes = blocks.points[blocks.first[:-1] + low]
    others = _blocks_around(blocks)
    x, y, z = (nodes[others] - nodes[:, None]).transpose(2, 0, 1)
    gradient = np.empty((len(lowest), 2))
    gradient[blocks.rows] = np.repeat(_low_slopes(x, y, z, others >= 0), n, axis=0)
    return gradient


def _blocks_around(blocks: CellGrid) -> NDArray[np.int64]:
    """Return the blocks within reach of each, itself among them, −1 where there is none."""
    across = np.arange(-REACH, REACH + 1)
    column = (blocks.numbers % blocks.n_columns)[:, None, None] + across
    wanted = blocks.numbers[:, None, None] + across[:, None] * blocks.n_columns + across
    found = np.minimum(np.searchsorted(blocks.numbers, wanted), len(blocks.numbers) - 1)
    is_there = (blocks.numbers[found] == wanted) & (column >= 0) & (column < blocks.n_columns)
    return np.where(is_there, found, -1).reshape(len(blocks.numbers), -1)


def _low_slopes(
    x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64], kept: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return the slopes of planes through the low ones of the kept points, as far as they explain these."""
    is_known = kept.sum(axis=1) >= MIN_BLOCKS
    kept = kept | ~is_known[:, None]  # a row without any has no mean; what is not known is 0 in the end
    plane = _planes(x, y, z, kept)
    for _ in range(MAX_PASSES):
        above = z - (plane[2] + plane[0] * x + plane[1] * y)
        highest = above.max(axis=1, where=kept, initial=0.0)
        fewer = kept & (above <= np.maximum(0.5 * highest, SMOOTH)[:, None])
        n_fewer = fewer.sum(axis=1)
        changes = (n_fewer < kept.sum(axis=1)) & (n_fewer >= MIN_BLOCKS)
        if not changes.any():
            break
        kept = np.where(changes[:, None], fewer, kept)
        plane = _planes(x, y, z, kept)
    variance = z.var(axis=1, where=kept)
    left = (z - plane[0] * x - plane[1] * y).var(axis=1, where=kept)
    explained = np.maximum(0.0, 1.0 - np.divide(left, variance, out=np.ones_like(left), where=variance > 0.0))
    return np.where(is_known, explained, 0.0)[:, None] * np.hstack(plane[:2])


def _planes(
    x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64], kept: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """
    Return rise over run along x and y and the elevation at 0 of planes through the kept; level if undefined.
    """
    means = [values.mean(axis=1, where=kept, keepdims=True) for values in (x, y, z)]
    dx, dy, dz = (values - mean for values, mean in zip((x, y, z), means, strict=True))

    def total(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return values.sum(axis=1, where=kept, keepdims=True)

    xx, xy, yy, xz, yz = total(dx * dx), total(dx * dy), total(dy * dy), total(dx * dz), total(dy * dz)
    area = xx * yy - xy * xy
    is_defined = (area > 1e-3 * xx * yy) & (area > 0.0)
    area = np.where(is_defined, area, np.inf)
    east = np.clip((xz * yy - yz * xy) / area, -MAX_GRADIENT, MAX_GRADIENT)
    north = np.clip((yz * xx - xz * xy) / area, -MAX_GRADIENT, MAX_GRADIENT)
    return east, north, means[2] - east * means[0] - north * means[1]
