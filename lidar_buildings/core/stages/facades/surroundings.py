"""What lies about walls: the points near a curve, and what was seen before, behind and over it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.cell_grid import CellGrid, rows_by_cell
from lidar_buildings.core.stages.facades.curves import Curve

Floats = NDArray[np.float64]

#: Side of the cells by which points are found [m].
POINT_CELL = 1.0
#: Side of the cells that tell what was seen of a place [m].
PLACE_CELL = 0.5
_BESIDE = np.array([(i, k) for k in (-1, 0, 1) for i in (-1, 0, 1)])


class _Cells:
    """Cells of a plan grid that hold something, to be found by their places."""

    def __init__(self, points: Floats, size: float) -> None:
        self.grid: CellGrid = rows_by_cell(points, size)
        corner = np.zeros(2)
        if len(points):
            corner = np.floor(self.grid.points[0, :2] / self.grid.size) - self.grid.places[0, ::-1]
        self._corner = corner.astype(np.int64)

    def at(self, xy: Floats) -> NDArray[np.int64]:
        """Return column and row of positions, shape (n, 2)."""
        return np.floor(xy / self.grid.size).astype(np.int64) - self._corner

    def held(self, cells: NDArray[np.int64]) -> NDArray[np.intp]:
        """Return which cell of the grid each is, −1 where nothing lies."""
        if not len(self.grid.numbers):
            return np.full(len(cells), -1, dtype=np.intp)
        number = cells[:, 1] * self.grid.n_columns + cells[:, 0]
        found = np.minimum(np.searchsorted(self.grid.numbers, number), len(self.grid.numbers) - 1)
        known = (self.grid.numbers[found] == number) & (cells[:, 0] >= 0)
        known &= cells[:, 0] < self.grid.n_columns
        return np.where(known, found, -1)


class PointsAbout:
    """The points of a cloud that may be of walls."""

    def __init__(self, points: Floats, height: Floats, is_core: NDArray[np.bool_]) -> None:
        self._cells = _Cells(points, POINT_CELL)
        rows = self._cells.grid.rows
        self.points = self._cells.grid.points
        self.height, self.is_core = height[rows], is_core[rows]

    def near(self, curve: Curve, first: float, last: float, reach: float) -> tuple[NDArray[np.intp], Floats]:
        """Return the points within reach (≤ 1 m) of a stretch of a curve: rows, and places on it."""
        steps = np.linspace(first, last, int(np.ceil((last - first) / (0.5 * POINT_CELL))) + 2)
        cells = (self._cells.at(curve.at(steps))[:, None] + _BESIDE).reshape(-1, 2)
        held = np.unique(self._cells.held(cells))
        held = held[held >= 0]
        starts = self._cells.grid.first
        runs = [np.arange(starts[k], starts[k + 1]) for k in held]
        rows = np.concatenate(runs) if runs else np.zeros(0, dtype=np.intp)
        place, offset = curve.seen_from(self.points[rows, :2])
        near = (place >= first) & (place <= last) & (np.abs(offset) <= reach)
        return rows[near], place[near]


class Scenery:
    """Whether ground was seen at a place, and how high above ground what else was."""

    def __init__(self, ground: Floats, others: Floats, height: Floats) -> None:
        self._ground, self._others = _Cells(ground, PLACE_CELL), _Cells(others, PLACE_CELL)
        grid = self._others.grid
        begins = grid.first[:-1]
        own = height[grid.rows]
        self._highest = np.maximum.reduceat(own, begins) if len(begins) else np.zeros(0)

    def along(self, curve: Curve, place: Floats, across: Floats) -> tuple[NDArray[np.bool_], Floats]:
        """
        Return whether ground was seen, and the height of what is highest above ground, −inf where nothing.

        Both of shape (n_places, n_across): at so many places along the curve, so far on its left [m].
        """
        at = curve.at(place)[:, None] + across[None, :, None] * curve.normals_at(place)[:, None]
        shape, at = at.shape[:2], at.reshape(-1, 2)
        is_ground = self._ground.held(self._ground.at(at)) >= 0
        held = self._others.held(self._others.at(at))
        highest = np.full(len(held), -np.inf)
        highest[held >= 0] = self._highest[held[held >= 0]]
        return is_ground.reshape(shape), highest.reshape(shape)
