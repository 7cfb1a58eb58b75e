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
#: Blocks whose variance across a line is less than this share of that along it tell no slope across.
MIN_SPREAD = 1e-3


def terrain_gradient(lowest: NDArray[np.float64], cell: float) -> NDArray[np.float64]:
    """
    Return the terrain's rise over run along x and y in each cell, shape (n_cells, 2), from its lowest point.

    Each block of cells has the elevation below which a quarter of its cells reach. The plane of least squares
    through the blocks around counts as far as it explains how they differ.
    """
    blocks = sort_by_cell(lowest, BLOCK_CELLS * cell)
    n = np.diff(blocks.first)
    nodes = blocks.points[blocks.first[:-1] + (LOW_SHARE * n).astype(np.int64)]
    others = _blocks_around(blocks)
    known = (others >= 0)[..., None]
    n_known = known.sum(axis=1, keepdims=True)
    away = np.where(known, nodes[others] - nodes[:, None], 0.0)
    away = known * (away - away.sum(axis=1, keepdims=True) / n_known)
    products = np.swapaxes(away, 1, 2) @ away
    rise, variance = products[:, :2, 2:], products[:, 2:, 2:]
    slope = np.linalg.pinv(products[:, :2, :2], MIN_SPREAD, hermitian=True) @ rise
    explained = np.divide(
        (slope * rise).sum(axis=1, keepdims=True), variance, out=np.zeros_like(variance), where=variance > 0.0
    )
    gradient = np.empty((len(lowest), 2))
    gradient[blocks.rows] = np.repeat(((n_known >= MIN_BLOCKS) * explained * slope)[..., 0], n, axis=0)
    return gradient


def _blocks_around(blocks: CellGrid) -> NDArray[np.int64]:
    """Return the blocks within reach of each, itself among them, −1 where there is none."""
    across = np.arange(-REACH, REACH + 1)
    column = (blocks.numbers % blocks.n_columns)[:, None, None] + across
    wanted = blocks.numbers[:, None, None] + across[:, None] * blocks.n_columns + across
    found = np.minimum(np.searchsorted(blocks.numbers, wanted), len(blocks.numbers) - 1)
    is_there = (blocks.numbers[found] == wanted) & (column >= 0) & (column < blocks.n_columns)
    return np.where(is_there, found, -1).reshape(len(blocks.numbers), -1)
