"""How well each plane fits the points over each cell."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.few_rows import rows_by_group
from lidar_buildings.core.stages.building_model.cells import Cells

#: What a point is off its plane beyond this [m], and the share of it that counts: chimneys and antennas pull
#: on no plane, and a tower is neither.
MAX_MISFIT, TAIL = 1.0, 0.1
#: Rise over run of 60°: from here on distances from a plane count along its normal.
STEEP = 1.73
#: What a roof may lie above the highest return around [m], beside what the spacing explains.
ABOVE = 0.3
#: Points so many spacings around a corner of a cell tell how high and how low the roof may be there,
AROUND = 3.0
#: and for a square of so many spacings of the cell, at most, it speaks.
_SPOKEN = 5.0
#: Most squares of the raster in which points share what they stand for.
_MAX_SQUARES = 40_000


def plane_costs(
    points: FloatArray,
    near: tuple[Any, ...],
    weight: FloatArray,
    cell: IntArray,
    cells: Cells,
    planes: FloatArray,
    spacing: float,
) -> FloatArray:
    """
    Return what it costs to roof each cell with each plane [m³], shape (n_cells, n_planes).

    That is the misfit to its points, and how far the plane lies above or below the returns around a corner
    of the cell, where that is most. A roof runs on for one spacing beyond its points. Distances are vertical,
    but from planes steeper than `STEEP`, where a pulse's place is less sure than its height, less by as much;
    those to points hardly count beyond `MAX_MISFIT`, so that chimneys and antennas pull on no plane. Points
    are (n_points, 3), `near` the same `by_square` [m]; `weight` is the area that each stands for [m²], `cell`
    its cell, int64, -1 for none; planes are a, b, c of z = a·x + b·y + c, (n_planes, 3).
    """
    slope = np.hypot(planes[:, 0], planes[:, 1])
    return _costs(
        points, near, weight, cell, np.ascontiguousarray(planes.T), counted_shares(planes),
        cells.vertices, cells.borders, cells.sides, cells.areas, ABOVE + spacing * slope, spacing,
    )  # fmt: skip


def counted_shares(planes: FloatArray) -> FloatArray:
    """Return the share of vertical distances from planes that counts."""
    slope = np.hypot(planes[:, 0], planes[:, 1])
    return np.asarray(np.minimum(np.hypot(1.0, STEEP) / np.hypot(1.0, slope), 1.0))


@inner_kernel
def misfit_of(off):  # type: ignore[no-untyped-def]
    """Return what of a distance counts [m]."""
    return off if off < MAX_MISFIT else MAX_MISFIT + TAIL * (off - MAX_MISFIT)


@kernel
def _squares_over(places, spacing):  # type: ignore[no-untyped-def]
    """Return the squares over places: side, south-western column and row, numbers of both."""
    west, south, east, north = np.inf, np.inf, -np.inf, -np.inf
    for i in range(len(places)):
        west, south = min(west, places[i, 0]), min(south, places[i, 1])
        east, north = max(east, places[i, 0]), max(north, places[i, 1])
    side = max(spacing, math.sqrt((east - west) * (north - south) / _MAX_SQUARES))
    column, row = np.floor(west / side), np.floor(south / side)
    n_columns, n_rows = int(np.floor(east / side) - column) + 1, int(np.floor(north / side) - row) + 1
    return side, column, row, n_columns, n_rows


@inner_kernel
def _square_of(x, y, squares):  # type: ignore[no-untyped-def]
    """Return the number of the square that a place lies in, -1 beside all."""
    side, first_column, first_row, n_columns, n_rows = squares
    column, row = np.floor(x / side) - first_column, np.floor(y / side) - first_row
    if 0.0 <= column < n_columns and 0.0 <= row < n_rows:
        return int(column) * n_rows + int(row)
    return -1


@kernel
def point_weights(points, exterior, spacing):  # type: ignore[no-untyped-def]
    """
    Return the area that each point stands for [m²]: it shares a square of a spacing with others in it.

    Points beside the bounding box of the outline's exterior stand for none.
    """
    squares = _squares_over(exterior, spacing)
    shared, square = np.zeros(squares[3] * squares[4], np.int64), np.empty(len(points), np.int64)
    for i in range(len(points)):
        square[i] = _square_of(points[i, 0], points[i, 1], squares)
        if square[i] >= 0:
            shared[square[i]] += 1
    weights = np.zeros(len(points))
    for i in range(len(points)):
        if square[i] >= 0:
            weights[i] = squares[0] ** 2 / shared[square[i]]
    return weights


@kernel
def by_square(points, side):  # type: ignore[no-untyped-def]
    """Return points square by square, where those of each begin, the squares, and the ends of all heights."""
    squares, square = _squares_over(points, side), np.empty(len(points), np.int64)
    for i in range(len(points)):
        square[i] = _square_of(points[i, 0], points[i, 1], squares)
    rows, first = rows_by_group(square, squares[3] * squares[4])
    return points[rows], first, squares, (points[:, 2].min(), points[:, 2].max())


@kernel
def heights_near(places, near, reach):  # type: ignore[no-untyped-def]
    """
    Return the lowest and the highest point within `reach` of each place in plan [m]; without any ∞ and −∞.

    `near` are points as `by_square` gives them.
    """
    points, first, (side, column, row, n_columns, n_rows), _ = near
    low, high = np.full(len(places), np.inf), np.full(len(places), -np.inf)
    for i in range(len(places)):
        x, y = places[i, 0], places[i, 1]
        west = max(int(np.floor((x - reach) / side) - column), 0)
        east = min(int(np.floor((x + reach) / side) - column) + 1, n_columns)
        south = min(max(int(np.floor((y - reach) / side) - row), 0), n_rows)
        north = min(max(int(np.floor((y + reach) / side) - row) + 1, south), n_rows)
        for k in range(west, east):
            for j in range(first[k * n_rows + south], first[k * n_rows + north]):
                dx, dy, z = points[j, 0] - x, points[j, 1] - y, points[j, 2]
                if dx * dx + dy * dy <= reach * reach:
                    low[i], high[i] = min(low[i], z), max(high[i], z)
    return low, high


@kernel
def _costs(points, near, weight, cell, planes, counted, vertices, borders, sides, areas, slack, spacing):  # type: ignore[no-untyped-def]
    """See `plane_costs`; planes in columns."""
    n_planes, spoken = planes.shape[1], (_SPOKEN * spacing) ** 2
    low, high = heights_near(vertices, near, AROUND * spacing)
    costs, beyond = np.empty((len(areas), n_planes)), np.zeros((len(areas), n_planes))
    # Rows of their own, so that the loops over planes become wide (SIMD).
    a, b, d = planes[0], planes[1], planes[2]
    for e in range(len(borders)):
        for end in range(2):
            v = borders[e, end]
            x, y = vertices[v, 0], vertices[v, 1]
            bottom, top = (low[v], high[v]) if low[v] <= high[v] else (-np.inf, near[3][1])
            for side in range(2):
                c = sides[e, side]
                if c < 0 or sides[e, 0] == sides[e, 1]:
                    continue
                own = beyond[c]
                for k in range(n_planes):
                    z = a[k] * x + b[k] * y + d[k]
                    excess = max(z - top, bottom - z) - slack[k]
                    own[k] = excess if excess > own[k] else own[k]
    for c in range(len(costs)):
        for k in range(n_planes):
            costs[c, k] = beyond[c, k] * min(areas[c], spoken)
    for i in range(len(points)):
        c = cell[i]
        if c < 0:
            continue
        own = costs[c]
        x, y, z, w = points[i, 0], points[i, 1], points[i, 2], weight[i]
        for k in range(n_planes):
            own[k] += w * misfit_of(counted[k] * abs(z - (a[k] * x + b[k] * y + d[k])))
    return costs
