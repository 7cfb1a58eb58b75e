"""The trend of a terrain: local planes through ground points, on a grid."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.neighbours.parallel import for_row_blocks

# Chosen with `bench.ground.isprs` where they matter; the first and the last have wide margins.
#: Fineness of the grid, and largest number of its cells: they grow beyond.
CELLS_PER_RADIUS, MAX_CELLS = 4.0, 4_000_000
#: Where there is no ground near, ground so many radii away says how the trend goes on, with little weight.
FAR, FAR_WEIGHT = 4.0, 1e-3
#: Weight of the mean of all, where there is none at all.
FLOOR = 1e-9


@dataclass(frozen=True, eq=False)
class Trend:
    """A smooth surface, given at the middles of square cells."""

    elevation: NDArray[np.float64]  #: [m], shape (n_rows, n_columns)
    gradient: tuple[NDArray[np.float64], NDArray[np.float64]]  #: rise over run along x and y
    corner: NDArray[np.float64]  #: south-west corner of the grid [m], shape (2,)
    cell: float  #: side of a cell [m]

    def elevation_at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the trend's elevation at points [m]."""
        return self._at(self.elevation, points)

    def gradient_at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the trend's gradient at points, shape (n_points, 2)."""
        return np.column_stack([self._at(part, points) for part in self.gradient])

    def _at(self, values: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
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
    low, high = extent_of(points)[:, :2]
    while np.prod((high - low) / cell + 3.0) > MAX_CELLS:
        cell *= 2.0
    corner = (np.floor(low / cell) - 1.0) * cell
    columns, rows = (np.floor((high - corner) / cell) + 2.0).astype(int)
    x, y = (points[ground, :2] - corner).T
    base = points[:, 2].min()
    z = points[ground, 2] - base
    number = (y // cell).astype(np.intp) * columns + (x // cell).astype(np.intp)
    products = (np.ones(len(z)), x, y, z, x * x, x * y, y * y, x * z, y * z)
    moments = np.empty((len(products), rows, columns))

    def smooth(begin: int, end: int) -> None:
        for k in range(begin, end):
            sums = np.bincount(number, products[k], rows * columns).astype(np.float64)
            moments[k] = _smoothed(sums.reshape(rows, columns), radius / cell)

    for_row_blocks(smooth, len(products), 1)
    middle_y, middle_x = (np.indices((rows, columns)) + 0.5) * cell
    elevation, slope_x, slope_y = _planes(moments, middle_x, middle_y, 0.1 * cell * cell)
    return Trend(base + elevation, (slope_x, slope_y), corner, cell)


def _planes(
    moments: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64], level: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """
    Return the elevations at (x, y) and the slopes of the planes of least squares, from sums of products.

    `level` is added to the variances in plan [m²]: points that are all near one place, or on a line, have no
    slope beyond it.
    """
    weight = np.maximum(moments[0], 1e-30)
    mx, my, mz, mxx, mxy, myy, mxz, myz = moments[1:] / weight
    xx, yy, xy = mxx - mx * mx + level, myy - my * my + level, mxy - mx * my
    xz, yz = mxz - mx * mz, myz - my * mz
    determinant = xx * yy - xy * xy
    slope_x, slope_y = (yy * xz - xy * yz) / determinant, (xx * yz - xy * xz) / determinant
    return mz + slope_x * (x - mx) + slope_y * (y - my), slope_x, slope_y


def _smoothed(sums: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """Smooth sums, with a little of what lies further away where there is nothing near."""
    return _blur(sums, sigma) + FLOOR * sums.mean() + FAR_WEIGHT * _blur(sums, FAR * sigma)


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
