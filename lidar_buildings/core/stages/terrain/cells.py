"""
The cells of a window, filled from points: by the highest or the mean of their own, or by the TIN of others'.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.stages.terrain.cell_points import CellPoints, highest_points, mean_points
from lidar_buildings.core.stages.terrain.window import RasterWindow
from lidar_buildings.core.surfaces.triangulation import triangulate


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
        """Return the mean of each cell's points."""
        return mean_points(points, *self.window.cells_of(points, self.origin), self.window.shape)

    def highest(self, points: NDArray[np.float64]) -> CellPoints:
        """Return each cell's highest point."""
        return highest_points(points, *self.window.cells_of(points, self.origin), self.window.shape)

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
