"""Terrain under objects: growing discs pushed up from below do not reach what is narrower than they."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.neighbours.cell_grid import rows_by_cell
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.surfaces.elevation_raster import filled
from lidar_buildings.core.surfaces.morphology import opened

#: Side of the cells whose lowest points are opened [m].
CELL = 1.0
#: Side of the blocks that are worked on at a time, in cells: bounds the memory; wide margin.
BLOCK = 512
#: How far beyond the discs' reach a block looks at the terrain that its holes are filled from, in cells.
FILL_REACH = 32
# Chosen with `bench.ground.isprs` and `bench.ground.scenes` where no source is named.
#: Rise that is terrain whatever the radius [m].
STEP = 0.2
#: The eight cells around one.
AROUND = np.array([[True, True, True], [True, False, True], [True, True, True]])
#: Discs grow by so much [m].
RADIUS_STEP = 1.0


class Cells(NamedTuple):
    """The cells that points lie in, row by row."""

    place: NDArray[np.int64]  #: row and column of each point's cell, counted from `first`, (n_points, 2)
    by_row: NDArray[np.intp]  #: the points by the row of their cell, shape (n_points,)
    first: NDArray[np.float64]  #: least row and column in the grid that starts at (0, 0), shape (2,)


def opened_terrain(
    points: NDArray[np.float64], largest_radius: float, max_slope: float, max_pit: float = np.inf
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Return the elevation of the terrain at each point [m], and its slope there (rise over run).

    The raster of cell minima is opened with discs of growing radius (Zhang et al. 2003), in small steps as
    Pingel et al. (2013) do it, up to the largest [m]; a cell that sinks by more than terrain of `max_slope`
    can rise over the radius is an object, and one lower than all eight around it by more than `max_pit` [m] a
    false low point. Cells without points take no part, so nothing is invented before
    the openings. The terrain is spanned between the cells left. Points come in any order.

    Worked on in blocks, each with what lies around it within reach of the largest disc: memory does not
    depend on the extent, and time is linear in the number of occupied blocks and of points. What lies
    beyond has no influence.
    """
    found = np.empty((2, len(points)))
    if len(points) == 0:
        return found[0], found[1]
    place = np.floor(points[:, 1::-1] / CELL)
    first = place.min(axis=0)
    row_and_column = (place - first).astype(np.int64)
    cells = Cells(row_and_column, np.argsort(row_and_column[:, 0], kind="stable"), first)
    blocks = rows_by_cell(points, BLOCK * CELL)
    steps = [*np.arange(RADIUS_STEP, largest_radius, RADIUS_STEP).tolist(), largest_radius]
    radii = sorted({max(1, round(radius / CELL)) for radius in steps})

    def open_block(begin: int, end: int) -> None:
        own = blocks.rows[blocks.first[begin] : blocks.first[end]]
        found[:, own] = _of_block(points, own, cells, radii, max_slope, max_pit)

    for_row_blocks(open_block, len(blocks.numbers), 1)
    return found[0], found[1]


def _of_block(
    points: NDArray[np.float64],
    own: NDArray[np.intp],
    cells: Cells,
    radii: list[int],
    max_slope: float,
    max_pit: float,
) -> list[NDArray[np.float64]]:
    """Return elevation and slope at a block's points; the raster has all cells around that matter."""
    halo = 2 * radii[-1] + FILL_REACH
    start = np.floor(points[own[0], 1::-1] / (BLOCK * CELL)) * BLOCK - cells.first
    low = np.maximum(start.astype(np.int64) - halo, 0)
    high = np.minimum(start.astype(np.int64) + BLOCK + halo, cells.place.max(axis=0) + 1)
    begin, end = np.searchsorted(cells.place[cells.by_row, 0], (low[0], high[0]))
    near = cells.by_row[begin:end]
    near = near[(cells.place[near, 1] >= low[1]) & (cells.place[near, 1] < high[1])]
    lowest = np.full(high - low, np.inf)
    np.minimum.at(lowest, tuple((cells.place[near] - low).T), points[near, 2])
    if max_pit < np.inf:  # raised to the lowest around
        rim = ndimage.minimum_filter(lowest, footprint=AROUND, mode="nearest")
        is_amid = np.isfinite(ndimage.maximum_filter(lowest, 3, mode="nearest"))
        lowest = np.where(is_amid & (rim > lowest + max_pit), rim, lowest)
    window = cells.first + low
    terrain = filled(lowest, _ground_cells(lowest, radii, max_slope), (int(window[0]), int(window[1])))
    # Values belong to the middles of cells.
    at = (points[own, 1::-1] / CELL - window - 0.5).T
    return [
        ndimage.map_coordinates(raster, at, order=1, mode="nearest") for raster in (terrain, _slope(terrain))
    ]


def _ground_cells(lowest: NDArray[np.float64], radii: list[int], max_slope: float) -> NDArray[np.bool_]:
    known = np.isfinite(lowest)
    objects = np.zeros(lowest.shape, dtype=np.bool_)
    before = lowest
    for radius in radii:
        after = opened(before, radius)
        sunk = np.subtract(before, after, out=np.zeros_like(before), where=known)
        objects |= sunk > max_slope * radius * CELL + STEP
        before = after
    ground = known & ~objects
    return ground if ground.any() else known


def _slope(terrain: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rise over run by differences of the cells on both sides, level along an axis of one cell."""
    rises = (
        np.gradient(terrain, CELL, axis=k) if n > 1 else np.zeros_like(terrain)
        for k, n in enumerate(terrain.shape)
    )
    return np.hypot(*rises)
