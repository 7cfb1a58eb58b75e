"""The cells of a window: known or not, filled from points or by the TIN of others'."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.stages.terrain.interpolation import LINEAR, interpolator
from lidar_buildings.core.stages.terrain.kriging import Variogram, kriged
from lidar_buildings.core.stages.terrain.window import RasterWindow
from lidar_buildings.core.surfaces.morphology import square_distances

#: Coordinates are summed as whole multiples of 1/65536 m, so that sums do not depend on the points' order.
#: Wide margin: 15 µm, and 10⁶ points a cell with coordinates of 10⁵ m stay below 2⁵³.
_STEPS_PER_METRE = 65536.0
#: Cells so near an empty one are corners of the triangles that close it.
_RIM = 3
#: So many cells are filled at a time by the TIN: a block takes 20 MB.
_PLACES = 1 << 18
#: What a point is: of no account, or seen, or ground.
LEFT_OUT, SEEN, GROUND = range(3)


@dataclass(frozen=True, eq=False)
class CellPoints:
    """One point for each cell of some."""

    #: The cells, row by row, shape (n_cells,).
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    points: NDArray[np.float64]  #: each within its cell [m], shape (n_cells, 3)

    def mask(self, shape: tuple[int, int]) -> NDArray[np.bool_]:
        """Return an array in which these cells are True."""
        mask = np.zeros(shape, dtype=bool)
        mask[self.rows, self.columns] = True
        return mask

    def select(self, chosen: NDArray[np.bool_]) -> CellPoints:
        """Return those chosen by a mask."""
        return CellPoints(self.rows[chosen], self.columns[chosen], self.points[chosen])

    def near(self, cells: NDArray[np.bool_]) -> CellPoints:
        """Return those so near to chosen cells that they are corners of the triangles that cover these."""
        near = squared_distance(cells, _RIM)[self.rows, self.columns] <= _RIM * _RIM
        return self.select(near) if near.any() else self

    def joined(self, others: CellPoints) -> CellPoints:
        """Return these and those of other cells."""
        rows, columns = np.append(self.rows, others.rows), np.append(self.columns, others.columns)
        return CellPoints(rows, columns, np.vstack((self.points, others.points)))


class CellContents(NamedTuple):
    """What the cells of a window hold."""

    #: The cells with a core point, and with one of a neighbouring tile, shape (height, width).
    own: NDArray[np.bool_]
    others: NDArray[np.bool_]
    #: Means of ground points. The mean of points on a plane lies on it, with the noise of one point over the
    #: root of their number.
    ground: CellPoints
    #: Each cell's highest first return, its highest later one and its lowest point of all; of several as high
    #: the westernmost, then southernmost.
    first: CellPoints
    later: CellPoints
    lowest: CellPoints


@dataclass(frozen=True)
class Cells:
    """A window of cells and where the map frame lies in it."""

    window: RasterWindow  #: which cells
    origin: tuple[float, float]  #: what to add to map coordinates [m]

    def contents(
        self,
        points: NDArray[np.float64],
        kind: NDArray[np.uint8],
        is_core: NDArray[np.bool_],
        is_first: NDArray[np.bool_],
    ) -> CellContents:
        """
        Return what the cells hold, whatever the order of the points, all of which lie within the window.

        Their kind is `LEFT_OUT`, `SEEN` or `GROUND`; those of neighbouring tiles are no core points.
        """
        window = self.window
        holds, n, sums, best = _contents(
            points, kind, is_core, is_first, self.origin, window.resolution, window.column, window.row,
            window.width, window.height * window.width,
        )  # fmt: skip
        own, others = holds.view(bool).reshape(2, *window.shape)
        filled = np.flatnonzero(n)
        # Sums of whole numbers below 2⁵³ are exact in any order.
        ground = self._cell_points(filled, sums[filled] / (n[filled, None] * _STEPS_PER_METRE))
        some = [np.flatnonzero(rows >= 0) for rows in best]
        ends = (
            self._cell_points(one, points.take(rows[one], axis=0))
            for one, rows in zip(some, best, strict=True)
        )
        return CellContents(own, others, ground, *ends)

    def _cell_points(self, numbers: NDArray[np.int64], points: NDArray[np.float64]) -> CellPoints:
        return CellPoints(*np.divmod(numbers, self.window.width), points)

    def levelled(self, means: CellPoints) -> NDArray[np.float32]:
        """
        Return the elevations of cells' means, moved to the cells' middles along the slope there [m].

        The slope is that of the plane through a cell's own mean which fits the means of its eight neighbours
        best; NaN where those are too few, or too near in a direction, to tell.
        """
        number = np.full(self.window.shape, np.int32(-1))
        number[means.rows, means.columns] = np.arange(len(means.rows))
        padded = np.pad(number, 1, constant_values=-1)
        middles = self.window.centres(means.rows, means.columns, self.origin)
        width = self.window.resolution
        return _levelled(means.points, middles, means.rows, means.columns, padded, width * width)

    def elevations_at(
        self, vertices: CellPoints, chosen: NDArray[np.bool_], method: str = LINEAR
    ) -> NDArray[np.float32]:
        """
        Return elevations at the middles of chosen cells, row by row; NaN if there is no vertex [m].

        `method` is one of `interpolation.METHODS`.
        """
        places = np.flatnonzero(chosen)
        found = np.full(len(places), np.nan, dtype=np.float32)
        if len(places) == 0 or len(vertices.points) == 0:
            return found
        rows, columns = (np.flatnonzero(chosen.any(axis=axis))[[0, -1]] for axis in (1, 0))
        corners = extent_of(self.window.centres(rows, columns, self.origin))
        elevations = interpolator(vertices.points, corners, method)
        for start in range(0, len(places), _PLACES):
            some = np.divmod(places[start : start + _PLACES], chosen.shape[1])
            found[start : start + _PLACES] = elevations(self.window.centres(*some, self.origin))
        return found

    def kriged_at(
        self, vertices: CellPoints, chosen: NDArray[np.bool_], variogram: Variogram
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return elevations at the middles of chosen cells, row by row, and their variances [m], [m²]."""
        rows, columns = np.nonzero(chosen)
        return kriged(vertices.points, variogram, self.window.centres(rows, columns, self.origin))


@kernel
def _contents(points, kind, is_core, is_first, origin, size, column, row, width, n_cells):  # type: ignore[no-untyped-def]
    """Return 1 for cells with core points and with others, numbers and sums of ground points, and rows."""
    # These are those of each cell's highest first and later return and of its lowest point, −1 for none.
    holds = np.zeros((2, n_cells), dtype=np.uint8)
    n, sums = np.zeros(n_cells, dtype=np.int64), np.zeros((n_cells, 3))
    best = np.full((3, n_cells), np.int32(-1))
    for i in range(len(points)):
        if kind[i] == LEFT_OUT:
            continue
        east = np.int64(math.floor((points[i, 0] + origin[0]) / size)) - column
        south = -1 - np.int64(math.floor((points[i, 1] + origin[1]) / size)) - row
        at = south * width + east
        holds[0 if is_core[i] else 1, at] = 1
        if kind[i] == GROUND:
            n[at] += 1
            for axis in range(3):
                sums[at, axis] += np.rint(points[i, axis] * _STEPS_PER_METRE)
        for end in (0 if is_first[i] else 1, 2):
            k = best[end, at]
            if k >= 0:
                up = points[i, 2] - points[k, 2] if end < 2 else points[k, 2] - points[i, 2]
                if up < 0.0:
                    continue
                if up == 0.0 and (points[i, 0], points[i, 1]) >= (points[k, 0], points[k, 1]):
                    continue
            best[end, at] = i
    return holds, n, sums, best


@kernel
def _levelled(points, middles, rows, columns, number, spread):  # type: ignore[no-untyped-def]
    """Move elevations to the cells' middles."""
    # `number` has a cell's row of `points`, −1 for none, and a rim; `spread` is what the squared distances of
    # the neighbours must sum up to along each axis.
    levels = np.empty(len(points), dtype=np.float32)
    for i in range(len(points)):
        xx = xy = yy = xz = yz = 0.0
        for row in range(rows[i], rows[i] + 3):
            for column in range(columns[i], columns[i] + 3):
                k = number[row, column]
                if k >= 0:
                    x, y = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1]
                    z = points[k, 2] - points[i, 2]
                    xx, xy, yy, xz, yz = xx + x * x, xy + x * y, yy + y * y, xz + x * z, yz + y * z
        determinant = xx * yy - xy * xy
        levels[i] = np.nan
        if min(xx, yy) >= spread and determinant > 0.1 * xx * yy:
            east, north = middles[i, 0] - points[i, 0], middles[i, 1] - points[i, 1]
            rise = (yy * xz - xy * yz) * east + (xx * yz - xy * xz) * north
            levels[i] = points[i, 2] + rise / determinant
    return levels


#: Cells that share a side or a corner belong together.
ADJACENT = np.ones((3, 3), dtype=bool)


def closed(occupied: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """
    Close the gaps between occupied cells into which no circle fits (morphological closing, Serra 1982).

    A cell stays unknown where a circle of this radius that holds no occupied cell covers it. Nothing is added
    beyond the outline of the data: a straight edge stays where it is. Cells are known to half their side
    only, so circles keep half a cell away from occupied ones, lest every gap in an edge stay open. At least
    `reach` + 1 cells on each side are empty.
    """
    near = squared_distance(occupied, reach) <= reach * (reach + 1)  # (reach + ½)² in whole cells
    return squared_distance(~near, reach) > reach * reach


def regions_touching(cells: NDArray[np.bool_], chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the connected regions, corners included, of some cells that have a chosen one."""
    number, n_regions = ndimage.label(cells, ADJACENT)
    is_touching = np.zeros(n_regions + 1, dtype=bool)
    is_touching[number[chosen]] = True
    is_touching[0] = False
    return is_touching[number]


def squared_distance(marked: NDArray[np.bool_], reach: int) -> NDArray[np.int32]:
    """
    Return each cell's squared distance to the nearest marked cell, both by their middles, in cells.

    Exact up to `reach` cells; beyond it, (`reach` + 1)² stands.
    """
    distances: NDArray[np.int32] = square_distances(marked.view(np.uint8), 1, reach)
    return distances
