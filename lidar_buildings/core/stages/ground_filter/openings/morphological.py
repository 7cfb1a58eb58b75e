"""The morphological filter: growing discs pushed up from below do not reach what is narrower than they."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.neighbours.cell_grid import cell_numbers, cell_order, lowest_per_cell
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.neighbours.windows import first_from
from lidar_buildings.core.stages.ground_filter.config import CANDIDATE_SPACING, GroundFilterConfig
from lidar_buildings.core.surfaces.elevation_raster import filled
from lidar_buildings.core.surfaces.morphology import opened

#: Side of the cells whose lowest points are opened [m].
CELL = CANDIDATE_SPACING
#: Side of the blocks that are worked on at a time, in cells: bounds the memory; wide margin.
BLOCK = 512
#: How far beyond the discs' reach a block looks at the terrain that its holes are filled from, in cells.
FILL_REACH = 32
# Chosen with `bench.ground.isprs` and `bench.ground.scenes` where no source is named.
#: Rise that is terrain whatever the radius [m].
STEP = 0.2
#: Discs grow by so much [m].
RADIUS_STEP = 1.0
#: Points this near the terrain that the openings leave are ground; so much more per unit of its slope [m].
DISTANCE, DISTANCE_SLOPE = 0.3, 1.25


class CellMinima(NamedTuple):
    """The lowest elevation in each occupied cell."""

    #: Row * columns + column of each, rising; counted from `first`, shape (n_cells,).
    numbers: NDArray[np.int64]
    elevation: NDArray[np.float64]  #: lowest point [m], shape (n_cells,)
    first: tuple[float, float]  #: row and column of the south-western cell in the grid that starts at (0, 0)
    shape: tuple[int, int]  #: rows and columns from the first to the last occupied cell


def label_ground(points: NDArray[np.float64], config: GroundFilterConfig) -> NDArray[np.bool_]:
    """
    Return which points are ground, by a progressive morphological filter.

    The raster of cell minima is opened with discs of growing radius (Zhang et al. 2003), in small steps as
    Pingel et al. (2013) do it; a cell that sinks by more than the terrain can rise over the radius is an
    object. Cells without points take no part, so nothing is invented before the openings. The terrain is
    spanned between the cells left, and points are ground within a distance of it that grows with its slope
    (Pingel et al. 2013).

    Points come in any order, gross errors removed.

    Notes
    -----
    Worked on in blocks, each with what lies around it within reach of the largest disc: memory does not
    depend on the extent, and time is linear in the number of occupied blocks and of points. What lies
    beyond has no influence.
    """
    ground = np.zeros(len(points), dtype=np.bool_)
    if len(points) == 0:
        return ground
    minima = _cell_minima(points)
    order = cell_order(points, BLOCK * CELL)
    starts = np.flatnonzero(np.diff(cell_numbers(points, BLOCK * CELL)[order], prepend=-1, append=-1))
    for_row_blocks(
        lambda k, _: _label_block(points, order[starts[k] : starts[k + 1]], minima, config, ground),
        len(starts) - 1,
        1,
    )
    return ground


def _cell_minima(points: NDArray[np.float64]) -> CellMinima:
    lowest = points[lowest_per_cell(points, CELL)]
    place = np.floor(lowest[:, 1::-1] / CELL)
    first = extent_of(place)[0]
    row, column = (place - first).astype(np.int64).T
    shape = int(row.max()) + 1, int(column.max()) + 1
    numbers = row * shape[1] + column
    order = np.argsort(numbers, kind="stable")
    return CellMinima(numbers[order], lowest[order, 2], (float(first[0]), float(first[1])), shape)


def _label_block(
    points: NDArray[np.float64],
    rows: NDArray[np.intp],
    minima: CellMinima,
    config: GroundFilterConfig,
    ground: NDArray[np.bool_],
) -> None:
    radii = _radii(config.opening_radius)
    halo = 2 * radii[-1] + FILL_REACH
    # The block's first cell, counted from the first occupied one.
    block = np.floor(points[rows[0], 1::-1] / (BLOCK * CELL)) * BLOCK - minima.first
    south, west = (max(0, int(start) - halo) for start in block)
    north, east = (min(n, int(start) + BLOCK + halo) for start, n in zip(block, minima.shape, strict=True))
    lowest = np.full((north - south, east - west), np.inf)
    _place(minima.numbers, minima.elevation, minima.shape[1], south, west, lowest)
    ground_cells = _ground_cells(lowest, radii, config)
    window = minima.first[0] + south, minima.first[1] + west
    terrain = filled(lowest, ground_cells, (int(window[0]), int(window[1])))
    _label(points, rows, terrain, _slope(terrain), window, ground)


def _radii(largest: float) -> list[int]:
    """Return the discs' radii in cells, rising: by steps up to the largest [m]."""
    radii = [*np.arange(RADIUS_STEP, largest, RADIUS_STEP).tolist(), largest]
    return sorted({max(1, round(radius / CELL)) for radius in radii})


def _ground_cells(
    lowest: NDArray[np.float64], radii: list[int], config: GroundFilterConfig
) -> NDArray[np.bool_]:
    """Return which cells show the ground; all that hold points if none does."""
    known = np.isfinite(lowest)
    objects = np.zeros(lowest.shape, dtype=np.bool_)
    before = lowest
    for radius in radii:
        after = opened(before, radius)
        objects |= _sunk(before, after, known, config.opening_slope * radius * CELL + STEP)
        before = after
    ground = known & ~objects
    return ground if ground.any() else known


def _sunk(
    before: NDArray[np.float64], after: NDArray[np.float64], known: NDArray[np.bool_], limit: float
) -> NDArray[np.bool_]:
    return np.subtract(before, after, out=np.zeros_like(before), where=known) > limit


@kernel
def _place(numbers, elevation, n_columns, south, west, lowest):  # type: ignore[no-untyped-def]
    """Set a window of the raster of minima, whose first cell is in row `south` and column `west`."""
    for y in range(lowest.shape[0]):
        start = (south + y) * n_columns + west
        k = first_from(numbers, start)
        while k < len(numbers) and numbers[k] < start + lowest.shape[1]:
            lowest[y, numbers[k] - start] = elevation[k]
            k += 1


@kernel
def _slope(terrain):  # type: ignore[no-untyped-def]
    n_rows, n_columns = terrain.shape
    slope = np.zeros(terrain.shape)
    for y in range(n_rows):
        south, north = max(y - 1, 0), min(y + 1, n_rows - 1)
        for x in range(n_columns):
            west, east = max(x - 1, 0), min(x + 1, n_columns - 1)
            along = (terrain[y, east] - terrain[y, west]) / (max(east - west, 1) * CELL)
            across = (terrain[north, x] - terrain[south, x]) / (max(north - south, 1) * CELL)
            slope[y, x] = math.hypot(along, across)
    return slope


@kernel
def _label(points, rows, terrain, slope, window, ground):  # type: ignore[no-untyped-def]
    """Set which points lie within a distance of the terrain that grows with its slope."""
    for p in rows:
        # Values belong to the middles of cells.
        y = min(max(points[p, 1] / CELL - window[0] - 0.5, 0.0), terrain.shape[0] - 1.0)
        x = min(max(points[p, 0] / CELL - window[1] - 0.5, 0.0), terrain.shape[1] - 1.0)
        distance = abs(points[p, 2] - _between(terrain, y, x))
        ground[p] = distance <= DISTANCE + DISTANCE_SLOPE * _between(slope, y, x)


@inner_kernel
def _between(raster, y, x):  # type: ignore[no-untyped-def]
    south, west = int(y), int(x)
    north, east = min(south + 1, raster.shape[0] - 1), min(west + 1, raster.shape[1] - 1)
    v, u = y - south, x - west
    low = (1.0 - u) * raster[south, west] + u * raster[south, east]
    high = (1.0 - u) * raster[north, west] + u * raster[north, east]
    return (1.0 - v) * low + v * high
