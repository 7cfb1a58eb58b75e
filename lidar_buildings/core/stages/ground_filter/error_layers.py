"""Columns of points split into layers, and how steep the terrain is: where gross errors are looked for."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.neighbours.cell_grid import CellGrid, cells_in_row, sort_by_cell


class Layers(NamedTuple):
    """What the search for gross errors looks at instead of points."""

    points: NDArray[np.float64]  #: sorted by column, and by z within it [m], shape (n_points, 3)
    #: Layer j holds the points begin[j] to begin[j + 1] (exclusive), shape (n_layers + 1,).
    begin: NDArray[np.int64]
    #: Column k holds the layers first[k] to first[k + 1] (exclusive), rising, shape (n_columns + 1,).
    first: NDArray[np.int64]
    column: NDArray[np.int64]  #: the column that each layer stands in, shape (n_layers,)
    numbers: NDArray[np.int64]  #: the columns' numbers, row by row; see `CellGrid`, shape (n_columns,)
    width: int  #: by how much the number of a column's northern neighbour is higher
    size: float  #: side of a column [m]
    #: The terrain's rise over run along x and y; see `terrain_gradient`, shape (n_columns, 2).
    gradient: NDArray[np.float64]


def split_into_layers(cloud: CellGrid, gap: float) -> Layers:
    """Split each column where two points on top of one another are more than `gap` [m] apart."""
    starts = np.ones(len(cloud.points), dtype=np.bool_)
    starts[1:] = np.diff(cloud.points[:, 2]) > gap
    starts[cloud.first[:-1]] = True
    begin = np.append(np.flatnonzero(starts), len(cloud.points))
    first = np.searchsorted(begin, cloud.first)
    column = np.repeat(np.arange(len(cloud.numbers)), np.diff(first))
    gradient = terrain_gradient(_lowest_of_weight(cloud.points, begin, first), cloud.size)
    return Layers(cloud.points, begin, first, column, cloud.numbers, cloud.n_columns, cloud.size, gradient)


#: A layer that holds less than this share of a column's points may be an error.
MIN_WEIGHT = 0.125


@kernel
def _lowest_of_weight(points, begin, first):  # type: ignore[no-untyped-def]
    """Return the lowest point of each column's lowest layer that holds a share of its points, or the most."""
    lowest = np.empty((len(first) - 1, 3))
    for k in range(len(first) - 1):
        most = 0
        for j in range(first[k], first[k + 1]):
            most = max(most, begin[j + 1] - begin[j])
        least = min(MIN_WEIGHT * (begin[first[k + 1]] - begin[first[k]]), most)
        j = first[k]
        while begin[j + 1] - begin[j] < least:
            j += 1
        for axis in range(3):
            lowest[k, axis] = points[begin[j], axis]
    return lowest


@inner_kernel
def columns_in_row(layers, k, step, reach):  # type: ignore[no-untyped-def]
    """Return the columns (start, stop) within `reach` of column k's place, in the row `step` north of it."""
    row, column = divmod(layers.numbers[k], layers.width)
    return cells_in_row(layers.numbers, layers.width, row + step, column, reach)


@kernel
def rise(layers, k, east, north):  # type: ignore[no-untyped-def]
    """Return by how much the terrain at column k would rise over steps of a column, if it were plane [m]."""
    return layers.size * (east * layers.gradient[k, 0] + north * layers.gradient[k, 1])


@inner_kernel
def low_end(layers, layer):  # type: ignore[no-untyped-def]
    """Return the elevation of a layer's lowest point [m]."""
    return layers.points[layers.begin[layer], 2]


@inner_kernel
def high_end(layers, layer):  # type: ignore[no-untyped-def]
    """Return the elevation of a layer's highest point [m]."""
    return layers.points[layers.begin[layer + 1] - 1, 2]


# Chosen with `bench.ground.noise`.
#: Cells along a block's side.
GRADIENT_CELLS = 8
#: The share of a block's cells whose lowest points lie below the elevation taken for it.
LOW_SHARE = 0.25
#: Blocks on each side that take part in the plane through a block.
GRADIENT_REACH = 2
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
    blocks = sort_by_cell(lowest, GRADIENT_CELLS * cell)
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
    across = np.arange(-GRADIENT_REACH, GRADIENT_REACH + 1)
    column = (blocks.numbers % blocks.n_columns)[:, None, None] + across
    wanted = blocks.numbers[:, None, None] + across[:, None] * blocks.n_columns + across
    found = np.minimum(np.searchsorted(blocks.numbers, wanted), len(blocks.numbers) - 1)
    is_there = (blocks.numbers[found] == wanted) & (column >= 0) & (column < blocks.n_columns)
    return np.where(is_there, found, -1).reshape(len(blocks.numbers), -1)
