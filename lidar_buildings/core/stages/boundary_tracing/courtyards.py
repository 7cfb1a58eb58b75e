"""Courtyards: empty discs inside an outer ring, and the criteria that make one of them a courtyard."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from lidar_buildings.core.model.outline import signed_area
from lidar_buildings.core.stages.boundary_tracing.point_grid import PointGrid, inside

#: A roof that is narrow along more of a courtyard's rim than this is the rim of a roof without returns.
_MAX_NARROW_SHARE = 0.5
#: Places along either axis that are tried as a disc's centre, about a cell's middle, then about the best.
_TRIED = (np.arange(8) - 3.5) / 8
#: Cells looked at: at most this many or so many per point; a vast gap is looked at coarsely.
_MAX_CELLS, _MAX_CELLS_PER_POINT = 1_000_000, 4


@dataclass(frozen=True)
class CourtyardRules:
    """Courtyard criteria: what makes a gap between roof points a courtyard."""

    radius: float  #: of the disc that has to fit in [m]
    min_area: float  #: smallest area [m²]
    min_band: float  #: width of the roof round most of it [m]

    def refusal(self, ring: NDArray[np.float64], narrow_share: float) -> str | None:
        """
        Say why the place inside a ring is no courtyard; nothing to say of small ones, None if it is one.

        `narrow_share` of its rim has a roof round it that is narrower than `min_band`.
        """
        if abs(signed_area(ring)) < self.min_area:
            return ""
        if narrow_share > _MAX_NARROW_SHARE:
            return "only the rim of the roof has points: the empty place inside is taken for roof"
        return None


def narrow_share(
    grid: PointGrid, hole: NDArray[np.int64], exterior: NDArray[np.int64], width: float
) -> float:
    """
    Return the share of a courtyard's rim along which the outer ring is nearer than a width.

    Distances are those between vertices, and each vertex of the rim stands for half of its two edges. The
    width is in half sides of the neighbourhood.
    """
    u, v = grid.ux * grid.x + grid.uy * grid.y, grid.vx * grid.x + grid.vy * grid.y
    rim, outer = np.column_stack((u[hole], v[hole])), np.column_stack((u[exterior], v[exterior]))
    distance, _ = cKDTree(outer).query(rim, p=2 if grid.is_disc else np.inf)
    edge = np.hypot(grid.x[hole] - np.roll(grid.x[hole], 1), grid.y[hole] - np.roll(grid.y[hole], 1))
    length = edge + np.roll(edge, -1)
    return float(length[distance <= width].sum() / length.sum())


class EmptyDiscs:
    """
    Looks for discs without points inside a ring, one by one.

    Every disc holds the whole of the cell that its centre is in, if a cell's side is radius / √2: only
    centres in empty cells are sought, and in most roofs there is no such cell. `ring` are the rows of the
    outer ring's vertices, `radius` is the discs' [m].
    """

    def __init__(self, grid: PointGrid, ring: NDArray[np.int64], radius: float) -> None:
        self._grid, self._radius = grid, radius
        size = np.hypot(grid.ux, grid.uy), np.hypot(grid.vx, grid.vy)
        # Axes of the grid's frame, in metres.
        self._axes = (grid.ux / size[0], grid.uy / size[0], grid.vx / size[1], grid.vy / size[1])
        self._side = radius / np.sqrt(2.0)
        width = grid.n_columns * grid.cell / size[0]
        height = grid.n_rows * grid.cell / size[1]
        limit = max(_MAX_CELLS, _MAX_CELLS_PER_POINT * len(grid.x))
        while (width / self._side + 1) * (height / self._side + 1) > limit:
            self._side *= 2.0
        self._n_columns, self._n_rows = int(width / self._side) + 1, int(height / self._side) + 1
        self._west, self._south = grid.west / size[0], grid.south / size[1]
        self._is_open = self._inside(ring)
        u, v = self._placed(grid.x, grid.y)
        rows = np.clip(v, 0.0, self._n_rows - 1.0).astype(np.int64)
        self._is_open[rows * self._n_columns + np.clip(u, 0.0, self._n_columns - 1.0).astype(np.int64)] = (
            False
        )
        self._is_empty = self._is_open.copy()
        self._cells = np.flatnonzero(self._is_open)
        self._last = 0
        if len(self._cells):
            points = np.column_stack((grid.x, grid.y))
            self._tree = cKDTree(points, balanced_tree=False, compact_nodes=False)

    def next_centre(self) -> tuple[float, float] | None:
        """Return the centre of a disc that fits into a gap not seen so far, None if there is none."""
        for k, cell in enumerate(self._cells.tolist()):
            if not self._is_open[cell]:
                continue
            row, column = divmod(cell, self._n_columns)
            u, v, size = column + 0.5, row + 0.5, 1.0
            for _ in range(2):
                tried = np.stack(np.meshgrid(u + size * _TRIED, v + size * _TRIED), axis=-1).reshape(-1, 2)
                clearance = self._tree.query(self._xy(tried))[0]
                (u, v), size = tried[np.argmax(clearance)], size / len(_TRIED)
            self._is_open[cell] = False
            if clearance.max() >= self._radius:
                self._cells, self._last = self._cells[k + 1 :], cell
                x, y = self._xy(np.array([[u, v]]))[0].tolist()
                return x, y
        return None

    def _xy(self, cells: NDArray[np.float64]) -> NDArray[np.float64]:
        ux, uy, vx, vy = self._axes
        u, v = (np.array([self._west, self._south]) + cells * self._side).T
        return np.column_stack((u * ux + v * vx, u * uy + v * vy))

    def close(self, ring: NDArray[np.int64]) -> None:
        """Look no more inside a ring."""
        self._is_open &= ~self._inside(ring)

    def give_up(self) -> None:
        """Look no more in the place that the last centre was in: its cells and all connected with them."""
        labels, _ = ndimage.label(self._is_empty.reshape(self._n_rows, self._n_columns))
        is_connected = labels.reshape(-1) == labels.reshape(-1)[self._last]
        self._is_open &= ~is_connected
        self._is_empty &= ~is_connected

    def _inside(self, ring: NDArray[np.int64]) -> NDArray[np.bool_]:
        polygon = shapely.Polygon(np.column_stack(self._placed(self._grid.x[ring], self._grid.y[ring])))
        v, u = np.divmod(np.arange(self._n_columns * self._n_rows), self._n_columns)
        return inside(np.column_stack((u, v)) + 0.5, polygon)

    def _placed(
        self, x: NDArray[np.float64], y: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        ux, uy, vx, vy = self._axes
        return (ux * x + uy * y - self._west) / self._side, (vx * x + vy * y - self._south) / self._side


def nearest_free(
    grid: PointGrid, follower: NDArray[np.int64], place: Sequence[float], n: int
) -> NDArray[np.int64]:
    """Return the rows of the up to n nearest points to a place that no ring has taken, the nearest first."""
    away = np.where(follower < 0, np.hypot(grid.x - place[0], grid.y - place[1]), np.inf)
    nearest = np.argsort(away, kind="stable")[:n]
    return nearest[np.isfinite(away[nearest])]
