"""
The trend of a terrain: local planes through ground points, on a grid.

"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

#: Cells per standard deviation of the weights.
CELLS_PER_RADIUS = 4.0
#: Largest number of cells; they grow beyond.
MAX_CELLS = 4_000_000
#: Where there is no ground near, ground so many radii away says how the trend goes on, with little weight.
FAR, FAR_WEIGHT = 4.0, 1e-3
#: Weight of the mean of all, where there is none at all.
FLOOR = 1e-9


@dataclass(frozen=True, eq=False)
class Trend:
    """
    A smooth surface, given at the middles of square cells.

    Attributes
    ----------
    elevation : ndarray of shape (n_rows, n_columns)
        [m].
    gradient : tuple of two ndarray of that shape
        Rise over run along x and y.
    corner : ndarray of shape (2,)
        South-west corner of the grid [m].
    cell : float
        Side of a cell [m].

    """

    elevation: NDArray[np.float64]
    gradient: tuple[NDArray[np.float64], NDArray[np.float64]]
    corner: NDArray[np.float64]
    cell: float

    def elevation_at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Return the trend's elevation at points [m].

        """
        return self._at(self.elevation, points)

    def gradient_at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Return the trend's gradient at points, shape (n_points, 2).

        """
        return np.column_stack([self._at(part, points) for part in self.gradient])

    def _at(self, values: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Interpolate between the middles of cells.

        """
        column, row = ((points[:, :2] - self.corner) / self.cell - 0.5).T
        return ndimage.map_coordinates(values, [row, column], order=1, mode="nearest")


def fit_trend(points: NDArray[np.float64], ground: NDArray[np.bool_], radius: float) -> Trend:
    """
    Fit a plane round the middle of every cell to the ground points, weighted by distance.

    The weights are Gaussian, so that all sums of all regressions come from smoothing grids of sums.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        At least one; the trend covers all of them [m].
    ground : ndarray of shape (n_points,), bool
        Those that it is fitted to.
    radius : float
        Standard deviation of the weights [m].

    """
    cell = radius / CELLS_PER_RADIUS
    low, extent = points[:, :2].min(axis=0), np.ptp(points[:, :2], axis=0)
    while np.prod(extent / cell + 3.0) > MAX_CELLS:
        cell *= 2.0
    corner = (np.floor(low / cell) - 1.0) * cell
    columns, rows = (np.floor((low + extent - corner) / cell) + 2.0).astype(int)
    x, y = (points[ground, :2] - corner).T
    base = points[:, 2].min()
    z = points[ground, 2] - base
    number = (y // cell).astype(np.intp) * columns + (x // cell).astype(np.intp)

    def smoothed(values: NDArray[np.float64]) -> NDArray[np.float64]:
        sums = np.bincount(number, values, rows * columns).astype(np.float64).reshape(rows, columns)
        near, far = (_blur(sums, reach * radius / cell) for reach in (1.0, FAR))
        return near + FAR_WEIGHT * far + FLOOR * sums.mean()

    weight = np.maximum(smoothed(np.ones(len(z))), 1e-30)
    mx, my, mz = (smoothed(values) / weight for values in (x, y, z))
    # Points that are all near one place, or on a line, have no slope beyond it.
    level = 0.1 * cell * cell
    xx, yy = smoothed(x * x) / weight - mx * mx + level, smoothed(y * y) / weight - my * my + level
    xy = smoothed(x * y) / weight - mx * my
    xz, yz = smoothed(x * z) / weight - mx * mz, smoothed(y * z) / weight - my * mz
    determinant = xx * yy - xy * xy
    slope_x, slope_y = (yy * xz - xy * yz) / determinant, (xx * yz - xy * xz) / determinant
    middle_y, middle_x = (np.indices((rows, columns)) + 0.5) * cell
    elevation = base + mz + slope_x * (middle_x - mx) + slope_y * (middle_y - my)
    return Trend(elevation, (slope_x, slope_y), corner, cell)


def _blur(values: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """
    Smooth with nearly Gaussian weights, three moving means one after another; nothing lies beyond the grid.

    """
    # Three means over w cells have a variance of (w² - 1) / 4.
    width = max(round(math.sqrt(4.0 * sigma * sigma + 1.0)), 1)
    width += 1 - width % 2
    for _ in range(3):
        values = ndimage.uniform_filter(values, width, mode="constant")
    return values
