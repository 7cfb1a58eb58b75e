"""The cloud as columns of layers: runs of points on top of one another without a larger gap between them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import CellGrid
from lidar_buildings.core.neighbours.windows import cells_in_row
from lidar_buildings.core.stages.ground_filter.gross_errors.terrain_gradient import terrain_gradient


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
    gradient = terrain_gradient(cloud.points[cloud.first[:-1]], cloud.size)
    return Layers(cloud.points, begin, first, column, cloud.numbers, cloud.n_columns, cloud.size, gradient)


@kernel
def columns_in_row(layers, k, step, reach):  # type: ignore[no-untyped-def]
    """
    Return the columns (start, stop) at most `reach` west and east of column k, in the row `step` north of it.
    """
    width = layers.width
    row, column = layers.numbers[k] // width, layers.numbers[k] % width
    return cells_in_row(layers.numbers, width, row + step, column, reach)


@kernel
def rise(layers, k, east, north):  # type: ignore[no-untyped-def]
    """Return by how much the terrain at column k would rise over steps of a column, if it were plane [m]."""
    return layers.size * (east * layers.gradient[k, 0] + north * layers.gradient[k, 1])


@kernel
def low_end(layers, layer):  # type: ignore[no-untyped-def]
    """Return the elevation of a layer's lowest point [m]."""
    return layers.points[layers.begin[layer], 2]


@kernel
def high_end(layers, layer):  # type: ignore[no-untyped-def]
    """Return the elevation of a layer's highest point [m]."""
    return layers.points[layers.begin[layer + 1] - 1, 2]
