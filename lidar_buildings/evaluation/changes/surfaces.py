"""What a survey saw in the cells around buildings: roofs, ground, and whatever else stood there."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import PointClass

#: Classes that say that nothing stood there.
_GROUND = (PointClass.GROUND, PointClass.WATER, PointClass.ROAD_SURFACE)
#: Classes that say nothing.
_NOISE = (PointClass.LOW_NOISE, PointClass.HIGH_NOISE)


class CellBlock(NamedTuple):
    """A rectangle of a plan's cells with a margin, as a raster."""

    cells: NDArray[np.int64]  #: which of the plan's cells lie in it
    places: tuple[NDArray[np.int64], NDArray[np.int64]]  #: row and column of each in the raster
    shape: tuple[int, int]  #: of the raster
    is_own: NDArray[np.bool_]  #: which of the cells lie in the rectangle, not in the margin

    @property
    def own(self) -> NDArray[np.int64]:
        """Which of the plan's cells lie in the rectangle."""
        return self.cells[self.is_own]


@dataclass(frozen=True)
class CellPlan:
    """The cells that are looked at, the same for both surveys."""

    size: float  #: side of a cell [m]
    low: tuple[int, int]  #: column and row of the south-western cell, counted in cells from (0, 0)
    shape: tuple[int, int]  #: rows and columns
    numbers: NDArray[np.int64]  #: the cells in or near an outline, rising: row by row from the south-west

    @classmethod
    def around(cls, polygons: NDArray[Any], size: float, margin: int) -> CellPlan:
        """Return the cells within some cells of polygons, of which there is at least one."""
        bounds = shapely.total_bounds(polygons)
        low = np.floor(bounds[:2] / size).astype(np.int64) - margin
        n_columns, n_rows = np.floor(bounds[2:] / size).astype(np.int64) + margin + 1 - low
        shape = (int(n_rows), int(n_columns))
        plan = cls(size, (int(low[0]), int(low[1])), shape, np.zeros(0, dtype=np.int64))
        grown = shapely.buffer(polygons, margin * size)
        numbers = [plan.cells_within(polygon)[0] for polygon in grown]
        return cls(size, plan.low, shape, np.unique(np.concatenate(numbers)))

    def middles(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the middles of cells of the plan, shape (n, 2) [m]."""
        return (np.column_stack([columns, rows]) + self.low + 0.5) * self.size

    def of_points(self, xy: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the numbers of the points' cells, −1 beyond the plan."""
        cell = np.floor(xy / self.size).astype(np.int64) - self.low
        is_in = ((cell >= 0) & (cell < self.shape[::-1])).all(axis=1)
        return np.where(is_in, cell[:, 1] * self.shape[1] + cell[:, 0], -1)

    def cells_within(self, polygon: Any) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the numbers and middles [m] of the cells whose middles lie in a polygon."""
        west, south, east, north = np.floor(np.array(shapely.bounds(polygon)) / self.size).astype(np.int64)
        rows = slice(max(south - self.low[1], 0), min(north - self.low[1] + 1, self.shape[0]))
        columns = slice(max(west - self.low[0], 0), min(east - self.low[0] + 1, self.shape[1]))
        row, column = (one.ravel() for one in np.mgrid[rows, columns])
        middles = self.middles(row, column)
        is_in = shapely.intersects_xy(polygon, *middles.T)
        return (row * self.shape[1] + column)[is_in], middles[is_in]

    def blocks(self, side: int, margin: int) -> Iterator[CellBlock]:
        """Yield the cells block by block, so many along a side, those that hold any."""
        row, column = np.divmod(self.numbers, self.shape[1])
        for north in range(0, self.shape[0], side):
            begin, end = np.searchsorted(row, (north - margin, north + side + margin))
            band = slice(begin, end)
            is_core = (row[band] >= north) & (row[band] < north + side)
            for east in np.unique(column[band][is_core] // side) * side:
                near = (column[band] >= east - margin) & (column[band] < east + side + margin)
                cells = begin + np.flatnonzero(near)
                y, x = row[cells], column[cells]
                low = np.array([y.min(), x.min()])
                own = (y >= north) & (y < north + side) & (x >= east) & (x < east + side)
                shape = (int(y.max() - low[0]) + 1, int(x.max() - low[1]) + 1)
                yield CellBlock(cells, (y - low[0], x - low[1]), shape, own)


class Surfaces:
    """
    What one survey saw in the cells of a plan; to be looked at when all points are added.

    Shapes are (n_cells,), elevations in [m]: the least, greatest and mean (`roof`) of points of roofs, NaN
    where there is none; the least and greatest of what is neither roof nor ground; the mean of `ground`.
    """

    def __init__(self, plan: CellPlan) -> None:
        n = len(plan.numbers)
        self._plan = plan
        self._counts, self._sums = np.zeros((2, 2, n))
        self.roof_low, self.other_low = np.full((2, n), np.inf)
        self.roof_high, self.other_high = np.full((2, n), -np.inf)

    def add(
        self, points: NDArray[np.float64], classes: NDArray[np.uint8], is_facade: NDArray[np.bool_]
    ) -> None:
        """Take points [m], their classes, and which of those of buildings are façade."""
        numbers = self._plan.of_points(points[:, :2])
        cell = np.searchsorted(self._plan.numbers, numbers)
        cell[cell == len(self._plan.numbers)] = 0
        is_seen = (self._plan.numbers[cell] == numbers) & ~np.isin(classes, _NOISE)
        is_roof = is_seen & (classes == PointClass.BUILDING) & ~is_facade
        is_ground = is_seen & np.isin(classes, _GROUND)
        for kind, rows in enumerate((is_roof, is_ground)):
            at = cell[rows]
            self._counts[kind] += np.bincount(at, minlength=len(self._counts[kind]))
            self._sums[kind] += np.bincount(at, points[rows, 2], len(self._counts[kind]))
        is_other = is_seen & ~is_roof & ~is_ground & ~is_facade
        for low, high, rows in (
            (self.roof_low, self.roof_high, is_roof),
            (self.other_low, self.other_high, is_other),
        ):
            np.minimum.at(low, cell[rows], points[rows, 2])
            np.maximum.at(high, cell[rows], points[rows, 2])

    @cached_property
    def roof(self) -> NDArray[np.float64]:
        """Mean elevation of roofs."""
        return self._mean(0)

    @cached_property
    def ground(self) -> NDArray[np.float64]:
        """Mean elevation of ground."""
        return self._mean(1)

    def _mean(self, kind: int) -> NDArray[np.float64]:
        counts = self._counts[kind]
        return np.where(counts > 0, self._sums[kind] / np.maximum(counts, 1.0), np.nan)


def see(plan: CellPlan, chunks: Iterable[tuple[NDArray[Any], ...]]) -> Surfaces:
    """Return what a survey saw, of chunks of points, classes and façade marks."""
    found = Surfaces(plan)
    for points, classes, facade in chunks:
        found.add(points, classes, facade.astype(bool))
    return found
