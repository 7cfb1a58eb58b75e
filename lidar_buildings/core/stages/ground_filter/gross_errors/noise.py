"""Gross errors: points far below the surface (multipath) and alone far above it (birds, clouds)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.neighbours.cell_grid import CellGrid, rows_by_cell, sort_by_cell
from lidar_buildings.core.stages.ground_filter.gross_errors.high_noise import (
    find_cloud_layers,
    find_high_layers,
)
from lidar_buildings.core.stages.ground_filter.gross_errors.low_noise import find_low_layers
from lidar_buildings.core.stages.ground_filter.gross_errors.noise_layers import split_into_layers

# Chosen with `bench.ground.noise` and the scenes of the tests.
#: A low error lies further than this below what surrounds it, a high one than that from everything else [m].
LOW_GAP, HIGH_GAP = 1.0, 10.0
#: Within how many columns around a low error hardly anything else lies as low.
RADIUS = 20
#: Most layers of a group of errors.
MAX_GROUP = 60
#: Side of the blocks in which occupied cells are counted, in cells; doubled until they hold as many.
BLOCK_CELLS = 16
#: Most cells that a column of the search may be wide.
MAX_COLUMN = 64
#: High errors stand apart by at least this many columns: sparse points are far from each other anyway.
MIN_GAP_COLUMNS = 10


def find_noise(cloud: CellGrid) -> NDArray[np.uint8]:
    """
    Return the class of gross errors, 7 or 18, and 0 elsewhere, in the order of `cloud`.

    Points are looked at in columns about as wide as their spacing, and there in layers. Errors are small
    groups of layers that are connected and lie apart from everything else: low ones below all that
    surrounds them, high ones in the air.
    The cells of `cloud` may be no larger than the columns have to be.
    """
    step = _column_cells(cloud)
    if step == 1:
        return _find_in_columns(cloud)
    columns = sort_by_cell(cloud.points, step * cloud.size)
    noise = np.empty(len(cloud.points), dtype=np.uint8)
    noise[columns.rows] = _find_in_columns(columns)
    return noise


def _find_in_columns(cloud: CellGrid) -> NDArray[np.uint8]:
    layers = split_into_layers(cloud, LOW_GAP)
    low = find_low_layers(layers, LOW_GAP, RADIUS, MAX_GROUP)
    high = find_cloud_layers(layers, low)
    high |= find_high_layers(layers, low, max(HIGH_GAP, MIN_GAP_COLUMNS * cloud.size), RADIUS)
    noise = np.zeros(len(low), dtype=np.uint8)
    noise[high] = PointClass.HIGH_NOISE
    noise[low] = PointClass.LOW_NOISE
    return np.repeat(noise, np.diff(layers.begin))


def _column_cells(cloud: CellGrid) -> int:
    """
    Return how many cells wide a column is: about as wide as points are apart, whole cells.

    Points are as far apart as in the block in which the middle cell lies: where most of them are.
    """
    lowest = cloud.points[cloud.first[:-1]]
    side = BLOCK_CELLS
    while True:
        counts = np.diff(rows_by_cell(lowest, side * cloud.size).first)
        occupied = np.median(np.repeat(counts, counts))
        if occupied >= BLOCK_CELLS or side >= MAX_COLUMN * BLOCK_CELLS:
            return int(min(max(round(side / np.sqrt(occupied)), 1), MAX_COLUMN))
        side *= 2
