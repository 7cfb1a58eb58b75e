"""
The cells of a window, filled from points: by the highest or the mean of their own, or by the TIN of others'.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.stages.terrain.window import RasterWindow
from lidar_buildings.core.surfaces.triangulation import triangulate

#: Coordinates are summed as whole multiples of 1/65536 m, so that sums do not depend on the points' order.
#: Wide margin: 15 µm, and 10⁹ points a cell with coordinates of 10⁵ m stay below 2⁶³.
_STEPS_PER_METRE = 65536.0


@dataclass(frozen=True, eq=False)
class CellPoints:
    """
    One point for each cell of some.

    Attributes
    ----------
    rows, columns : ndarray of shape (n_cells,), int64
        The cells, row by row.
    points : ndarray of shape (n_cells, 3)
        Each within its cell [m].
    """

    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    points: NDArray[np.float64]

    def mask(self, shape: tuple[int, int]) -> NDArray[np.bool_]:
        """Return an array in which these cells are True."""
        mask = np.zeros(shape, dtype=bool)
        mask[self.rows, self.columns] = True
        return mask

    def select(self, chosen: NDArray[np.bool_]) -> CellPoints:
        """Return those chosen by a mask."""
        return CellPoints(self.rows[chosen], self.columns[chosen], self.points[chosen])

    def joined(self, others: CellPoints) -> CellPoints:
        """Return these and those of other cells."""
        rows, columns = np.append(self.rows, others.rows), np.append(self.columns, others.columns)
        return CellPoints(rows, columns, np.vstack((self.points, others.points)))


@dataclass(frozen=True)
class Cells:
    """
    A window of cells and where the map frame lies in it.

    Attributes
    ----------
    window : RasterWindow
        Which cells.
    origin : tuple of two float
        What to add to map coordinates [m].
    """

    window: RasterWindow
    origin: tuple[float, float]

    def holding(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell which cells hold a point."""
        mask = np.zeros(self.window.shape, dtype=bool)
        mask[self.window.cells_of(points, self.origin)] = True
        return mask

    def means(self, points: NDArray[np.float64]) -> CellPoints:
        """
        Return the mean of the points of each cell that has any.

        The mean of points on a plane lies on it, with the noise of one point over the root of their number.
        """
        at = self.window.cells_of(points, self.origin)
        counts, sums = _summed(np.ascontiguousarray(points), *at, self.window.shape)
        rows, columns = np.nonzero(counts)
        n = counts[rows, columns]
        return CellPoints(rows, columns, sums[rows, columns] / (n[:, None] * _STEPS_PER_METRE))

    def highest(self, points: NDArray[np.float64]) -> CellPoints:
        """Return each cell's highest point; of several the westernmost, then southernmost."""
        at = self.window.cells_of(points, self.origin)
        highest = _highest(np.ascontiguousarray(points), *at, self.window.shape)
        rows, columns = np.nonzero(highest >= 0)
        return CellPoints(rows, columns, points[highest[rows, columns]])

    def lowest(self, points: NDArray[np.float64]) -> CellPoints:
        """Return each cell's lowest point."""
        turned = self.highest(points * [1.0, 1.0, -1.0])
        return CellPoints(turned.rows, turned.columns, turned.points * [1.0, 1.0, -1.0])

    def tin_at(self, vertices: CellPoints, chosen: NDArray[np.bool_]) -> NDArray[np.float32]:
        """
        Return the TIN's elevation at the middles of chosen cells, row by row; NaN if there is no vertex [m].
        """
        rows, columns = np.nonzero(chosen)
        if len(rows) == 0 or len(vertices.points) == 0:
            return np.full(len(rows), np.nan, dtype=np.float32)
        centres = self.window.centres(rows, columns, self.origin)
        extent = np.array([centres.min(axis=0), centres.max(axis=0)])
        return triangulate(vertices.points, extent).elevation(centres).astype(np.float32)


@njit(cache=True, nogil=True)
def _summed(points, rows, columns, shape):  # type: ignore[no-untyped-def]
    counts = np.zeros(shape, dtype=np.int32)
    sums = np.zeros((shape[0], shape[1], 3), dtype=np.int64)
    for i in range(len(points)):
        row, column = rows[i], columns[i]
        counts[row, column] += 1
        for axis in range(3):
            sums[row, column, axis] += np.int64(np.rint(points[i, axis] * _STEPS_PER_METRE))
    return counts, sums


@njit(cache=True, nogil=True)
def _highest(points, rows, columns, shape):  # type: ignore[no-untyped-def]
    """Return the row of each cell's highest point, −1 where it has none."""
    highest = np.full(shape, -1, dtype=np.int32)
    for i in range(len(points)):
        best = highest[rows[i], columns[i]]
        if best < 0 or _higher(points, i, best):
            highest[rows[i], columns[i]] = i
    return highest


@njit(cache=True, nogil=True)
def _higher(points, i, j):  # type: ignore[no-untyped-def]
    """Whether point i lies higher than point j, ties broken by x, then y."""
    if points[i, 2] != points[j, 2]:
        return points[i, 2] > points[j, 2]
    if points[i, 0] != points[j, 0]:
        return points[i, 0] < points[j, 0]
    return points[i, 1] < points[j, 1]
