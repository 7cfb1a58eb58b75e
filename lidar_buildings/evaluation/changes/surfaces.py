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
from lidar_buildings.evaluation.scores.cells import CellSet, cells_of_polygons, columns_and_rows, keys_of

#: Classes that say that nothing stood there.
_GROUND = (PointClass.GROUND, PointClass.WATER, PointClass.ROAD_SURFACE)
#: Classes that say nothing.
_NOISE = (PointClass.LOW_NOISE, PointClass.HIGH_NOISE)


class CellBlock(NamedTuple):
    """A rectangle of a plan's cells with a margin, as a raster."""

    cells: NDArray[np.int64]  #: which of the plan's cells lie in it
    places: tuple[NDArray[np.int64], NDArray[np.int64]]  #: column and row of each in the raster
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
    cells: CellSet  #: those in or near an outline

    @classmethod
    def around(cls, polygons: NDArray[Any], size: float, margin: int) -> CellPlan:
        """Return the cells within some cells of polygons, of which there is at least one."""
        return cls(size, cells_of_polygons(shapely.buffer(polygons, margin * size), size))

    def blocks(self, side: int, margin: int) -> Iterator[CellBlock]:
        """Yield the cells block by block, so many along a side, those that hold any."""
        column, row = columns_and_rows(self.cells)
        for west in np.unique(column // side) * side:
            begin, end = np.searchsorted(column, (west - margin, west + side + margin))
            band = slice(begin, end)
            is_core = (column[band] >= west) & (column[band] < west + side)
            for south in np.unique(row[band][is_core] // side) * side:
                near = (row[band] >= south - margin) & (row[band] < south + side + margin)
                cells = begin + np.flatnonzero(near)
                x, y = column[cells], row[cells]
                own = (x >= west) & (x < west + side) & (y >= south) & (y < south + side)
                shape = (int(np.ptp(x)) + 1, int(np.ptp(y)) + 1)
                yield CellBlock(cells, (x - x.min(), y - y.min()), shape, own)


class Surfaces:
    """
    What one survey saw in the cells of a plan; to be looked at when all points are added.

    Shapes are (n_cells,), elevations in [m]: the least, greatest and mean (`roof`) of points of roofs, NaN
    where there is none; the least and greatest of what is neither roof nor ground; the mean of `ground`.
    """

    def __init__(self, plan: CellPlan) -> None:
        n = len(plan.cells)
        self._plan = plan
        self._counts, self._sums = np.zeros((2, 2, n))
        self.roof_low, self.other_low = np.full((2, n), np.inf)
        self.roof_high, self.other_high = np.full((2, n), -np.inf)

    def add(
        self, points: NDArray[np.float64], classes: NDArray[np.uint8], is_facade: NDArray[np.bool_]
    ) -> None:
        """Take points [m], their classes, and which of those of buildings are façade."""
        keys = keys_of(points[:, :2], self._plan.size)
        cell = np.searchsorted(self._plan.cells, keys)
        cell[cell == len(self._plan.cells)] = 0
        is_seen = (self._plan.cells[cell] == keys) & ~np.isin(classes, _NOISE)
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
