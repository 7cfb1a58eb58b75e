"""A rough ground from the lowest points, for callers who have nothing but points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.neighbours.point_spacing import quantised_spacing
from lidar_buildings.core.surfaces.elevation_raster import filled, nearest_filled

#: Side of a cell: so many spacings, and at least so many metres.
CELL_SPACINGS = 2.0
MIN_CELL = 1.0
#: Largest number of cells in the raster, empty ones included; the cells grow beyond.
MAX_CELLS = 4_000_000
#: Widest object that is removed [m].
MAX_OBJECT = 60.0
#: Steepest terrain, rise over run, and the least and largest step that makes an object [m].
MAX_SLOPE = 0.3
MIN_STEP = 0.5
MAX_STEP = 2.5
#: Fits until the general slope of the ground is found under the buildings.
PLANE_ROUNDS = 8
#: Cells lower than all eight around them by more than this hold a false low point [m].
MAX_PIT = 1.0


def height_above_minimum(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Estimate heights above ground from the lowest points alone [m]; 0 for one point.

    A progressive morphological filter (Zhang and others, 2003): the raster of cell minima is opened with
    growing windows; a cell that sinks by more than the terrain can rise over the window is an object. Ground
    is interpolated across objects. Good to 0.1 m on even ground for 95 % of the points; on slopes it is lower
    by half a cell's rise. The ground filter stage is the better choice wherever it can be run.
    """
    if len(points) == 0:
        return np.zeros(0)
    cell = _cell_size(points)
    places = np.floor(points[:, 1::-1] / cell).astype(np.int64)
    first = places.min(axis=0)
    lowest = np.full(places.max(axis=0) - first + 1, np.inf)
    np.minimum.at(lowest, tuple((places - first).T), points[:, 2])
    known = np.isfinite(lowest)
    surface = _without_pits(nearest_filled(lowest, known))
    # Levelled, because an opening cuts off the upper rim of a slope.
    is_ground = known & _is_ground(surface - _lower_plane(surface), cell)
    if not is_ground.any():
        is_ground = known
    ground = filled(surface, is_ground, (int(first[0]), int(first[1])))
    # Values belong to the middles of cells.
    y, x = (points[:, 1::-1] / cell - first - 0.5).T
    return points[:, 2] - ndimage.map_coordinates(ground, [y, x], order=1, mode="nearest")


def _cell_size(points: NDArray[np.float64]) -> float:
    """Return the side of a cell, such that the raster stays small enough [m]."""
    cell = max(CELL_SPACINGS * quantised_spacing(points), MIN_CELL)
    while np.prod(np.diff(extent_of(points)[:, :2], axis=0) / cell + 1.0) > MAX_CELLS:
        cell *= 2.0
    return cell


def _without_pits(surface: NDArray[np.float64]) -> NDArray[np.float64]:
    """Raise cells that lie far below all eight around them to the lowest of those."""
    around = np.ones((3, 3), dtype=bool)
    around[1, 1] = False
    rim = ndimage.minimum_filter(surface, footprint=around, mode="nearest")
    return np.where(rim - surface > MAX_PIT, rim, surface)


def _lower_plane(surface: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the plane through the lower half of the cells, fitted in rounds."""
    row, column = np.indices(surface.shape)
    base = np.column_stack([row.ravel(), column.ravel(), np.ones(surface.size)])
    values = surface.ravel()
    lower = np.ones(len(values), dtype=bool)
    for _ in range(PLANE_ROUNDS):
        above = values - base @ np.linalg.lstsq(base[lower], values[lower], rcond=None)[0]
        lower = above <= np.median(above)
    return (values - above).reshape(surface.shape)


def _is_ground(surface: NDArray[np.float64], cell: float) -> NDArray[np.bool_]:
    """Tell which cells survive the opening with every window."""
    ground = np.ones(surface.shape, dtype=bool)
    half, before = 1, 0
    while before * cell < MAX_OBJECT / 2:
        opened = ndimage.grey_opening(surface, size=(2 * half + 1, 2 * half + 1), mode="nearest")
        step = np.clip(MAX_SLOPE * (half - before) * cell, MIN_STEP, MAX_STEP)
        ground &= surface - opened <= step
        surface, before, half = opened, half, 2 * half
    return ground
