"""How well each plane fits the points over each cell."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.stages.building_model.arrangement import Cells
from lidar_buildings.core.stages.building_model.line_tiles import in_tiles, tile_of

#: A point counts as so far off its plane at most [m].
MAX_MISFIT = 1.0
#: What a roof may lie above the highest return around [m], beside what the spacing explains.
ABOVE = 0.3
#: So many spacings around a corner of a cell tell how high the roof may be there, and for so much of the
#: cell, in square, it speaks. Compared with 3 to 6 on roofs that people drew and AHN3's: doc/algorithms.
_AROUND = 5
#: Most squares of the raster in which points share what they stand for.
_MAX_SQUARES = 40_000


class _Squares(NamedTuple):
    """Squares of a spacing, wider where they would be too many, at whole multiples of their side."""

    side: float
    first: FloatArray  #: column and row of the south-western one
    shape: tuple[int, int]

    @classmethod
    def over(cls, xy: FloatArray, spacing: float) -> _Squares:
        """Return those that some places need."""
        low, high = xy.min(axis=0), xy.max(axis=0)
        side = max(spacing, float(np.prod(high - low) / _MAX_SQUARES) ** 0.5)
        first, last = np.floor(low / side), np.floor(high / side)
        n_columns, n_rows = (last - first + 1.0).tolist()
        return cls(side, first, (int(n_columns), int(n_rows)))

    def of(self, points: FloatArray) -> IntArray:
        """Return the number of each point's square from 1 on; 0 for those beside all."""
        (west, south), (n_columns, n_rows) = self.first, self.shape
        column, row = np.floor(points[:, 0] / self.side) - west, np.floor(points[:, 1] / self.side) - south
        inside = (column >= 0.0) & (column < n_columns) & (row >= 0.0) & (row < n_rows)
        return np.where(inside, column * n_rows + row + 1.0, 0.0).astype(np.int64)


def cells_of_points(cells: Cells, points: FloatArray) -> IntArray:
    """Return the cell that each point lies in, -1 for those beside the outline."""
    # Lines that end inside a cell part nothing.
    parts = cells.sides[:, 0] != cells.sides[:, 1]
    lines = cells.vertices[cells.borders[parts]].reshape(-1, 4)
    tiles, start, items = in_tiles(lines)
    return _cells_above(points, lines, cells.sides[parts], tiles, start, items)


@kernel
def _cells_above(points, lines, sides, tiles, start, items):  # type: ignore[no-untyped-def]
    """
    Return what lies above the next edge below each point.

    The edges lead east. Above a vertex the steepest of those that leave it counts, whichever tile shows it
    first. Tiles that none of them touches lie in one cell.
    """
    west, south, side, n_columns, n_rows = tiles[0], tiles[1], tiles[2], int(tiles[3]), int(tiles[4])
    known = np.full(len(start) - 1, -2, np.int64)
    found = np.empty(len(points), np.int64)
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        column, row = tile_of(x, west, side, n_columns), tile_of(y, south, side, n_rows)
        cell, highest, steepest, empty = -1, -np.inf, 0.0, -1
        while row >= 0:
            tile = column * n_rows + row
            if start[tile] == start[tile + 1] and highest == -np.inf:
                if known[tile] != -2:
                    cell = known[tile]
                    break
                empty = tile
            for at in range(start[tile], start[tile + 1]):
                e = items[at]
                ax, bx = lines[e, 0], lines[e, 2]
                if not ax <= x < bx:
                    continue
                ay = lines[e, 1]
                slope = (lines[e, 3] - ay) / (bx - ax)
                z = ay + slope * (x - ax)
                if z <= y and (z > highest or (z == highest and slope > steepest)):
                    highest, steepest, cell = z, slope, sides[e, 0]
            if highest >= south + row * side:
                break
            row -= 1
        if empty >= 0:
            known[empty] = cell
        found[i] = cell
    return found


def plane_costs(
    points: FloatArray, weight: FloatArray, cell: IntArray, cells: Cells, planes: FloatArray, spacing: float
) -> FloatArray:
    """
    Return what it costs to roof each cell with each plane [m³], shape (n_cells, n_planes).

    That is the misfit to its points, and how far the plane lies above the returns around a corner of the
    cell, where that is most. A roof runs on for one spacing beyond its points. Distances are vertical; those
    to points count no more than `MAX_MISFIT`, so that chimneys and antennas pull on no plane.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        Roof points [m].
    weight : ndarray of shape (n_points,)
        Area that each stands for [m²].
    cell : ndarray of shape (n_points,), int64
        The cell of each point, -1 for none.
    cells : Cells
    planes : ndarray of shape (n_planes, 3)
        z = a·x + b·y + c.
    spacing : float
        Point spacing [m].
    """
    slack = spacing * np.hypot(planes[:, 0], planes[:, 1])
    seen = _highest_around(cells.vertices, points, spacing)
    costs = np.zeros((len(cells), len(planes)))
    _add_costs(
        points, weight, cell, np.ascontiguousarray(planes.T),
        cells.vertices, cells.borders, cells.sides, cells.areas,
        ABOVE + slack, seen, (_AROUND * spacing) ** 2, costs,
    )  # fmt: skip
    return costs


def point_weights(points: FloatArray, outline: Outline, spacing: float) -> FloatArray:
    """
    Return the area that each point stands for [m²]: it shares a square of a spacing with others in it.

    Points beside the outline's bounding box stand for none.
    """
    squares = _Squares.over(outline.exterior, spacing)
    square = squares.of(points)
    shared = squares.side**2 / np.maximum(np.bincount(square), 1)
    shared[0] = 0.0
    return shared[square]


def _highest_around(places: FloatArray, points: FloatArray, spacing: float) -> FloatArray:
    """Return the elevation of the highest return around each place, of all where there is none [m]."""
    squares = _Squares.over(places, spacing)
    highest = np.full(1 + squares.shape[0] * squares.shape[1], -np.inf)
    np.maximum.at(highest, squares.of(points), points[:, 2])
    around = highest[1:].reshape(squares.shape)
    around = ndimage.maximum_filter(around, 2 * _AROUND + 1, mode="constant", cval=-np.inf)
    found = around.ravel()[squares.of(places) - 1]
    return np.where(np.isinf(found), highest.max(), found)


@kernel
def _add_costs(  # type: ignore[no-untyped-def]
    points, weight, cell, planes, vertices, borders, sides, areas, high, seen, spoken, costs
):  # fmt: skip
    """Add to the costs of all planes."""
    n_planes = planes.shape[1]
    beyond = np.zeros(costs.shape)
    # Rows of their own, so that the loops over planes become wide (SIMD).
    a, b, d = planes[0], planes[1], planes[2]
    for e in range(len(borders)):
        for end in range(2):
            x, y = vertices[borders[e, end], 0], vertices[borders[e, end], 1]
            for side in range(2):
                c = sides[e, side]
                if c < 0 or sides[e, 0] == sides[e, 1]:
                    continue
                own = beyond[c]
                for k in range(n_planes):
                    excess = a[k] * x + b[k] * y + d[k] - seen[borders[e, end]] - high[k]
                    own[k] = excess if excess > own[k] else own[k]
    for c in range(len(costs)):
        for k in range(n_planes):
            costs[c, k] += beyond[c, k] * min(areas[c], spoken)
    for i in range(len(points)):
        c = cell[i]
        if c < 0:
            continue
        own = costs[c]
        x, y, z, w = points[i, 0], points[i, 1], points[i, 2], weight[i]
        for k in range(n_planes):
            misfit = abs(z - (a[k] * x + b[k] * y + d[k]))
            own[k] += w * (misfit if misfit < MAX_MISFIT else MAX_MISFIT)
