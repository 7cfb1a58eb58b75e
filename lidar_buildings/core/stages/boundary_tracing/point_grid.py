"""A building's distinct positions in cells, the neighbourhood of one, and which of them a ring holds."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.neighbours.few_rows import rows_by_group
from lidar_buildings.core.neighbours.point_spacing import distinct_positions
from lidar_buildings.core.neighbours.scan_pattern import ScanPattern

#: Cells that the grid may have: this many or so many per point; wide margin, memory only.
_MAX_CELLS, _MAX_CELLS_PER_POINT = 4096, 4
#: Rounding of coordinates: points nearer to a line than this lie on it [largest coordinate].
_ROUNDING = 4e-15
#: Points closer to the ring than this lie on it [half sides of the neighbourhood].
_ON_RING = 1e-6


class PointGrid(NamedTuple):
    """
    Distinct positions sorted into cells, in a frame whose axes are those of the neighbourhood.

    In that frame, whose unit is the neighbourhood's half sides, the neighbourhood is a square from −1 to 1,
    or the unit disc. Turning and stretching changes neither the order of directions round a point nor
    whether segments cross.
    """

    #: Cell by cell; within a cell by x, then y [m], shape (n_positions,).
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    #: Where each cell's positions begin; cells are numbered row by row, shape (n_cells + 1,).
    first: NDArray[np.int64]
    #: Cells along the frame's axes.
    n_columns: int
    n_rows: int
    cell: float  #: side of a cell [half sides of the neighbourhood]
    #: The frame's coordinates of the corner of cell 0.
    west: float
    south: float
    #: The frame's coordinates of a position are u = ux x + uy y and v = vx x + vy y [1/m].
    ux: float
    uy: float
    vx: float
    vy: float
    is_disc: bool  #: whether the neighbourhood is a disc
    rounding: float  #: points nearer to a line than this lie on it [m]
    #: 1 = rings are walked counter-clockwise, −1 = clockwise: walks see mirrored positions.
    orientation: int = 1


def build_point_grid(
    points: NDArray[np.float64], pattern: ScanPattern, window: float, *, is_rectangle: bool = False
) -> PointGrid:
    """
    Sort positions into cells, every position once.

    The neighbourhood's sides are so many spacings along and across the scan lines; it is a disc where both
    are the same, unless `is_rectangle`.
    """
    along, across = 0.5 * window * pattern.along, 0.5 * window * pattern.across
    cosine, sine = float(np.cos(pattern.direction)), float(np.sin(pattern.direction))
    frame = (cosine / along, sine / along, -sine / across, cosine / across)
    x, y = positions = np.ascontiguousarray(distinct_positions(points).T)
    u, v = frame[0] * x + frame[1] * y, frame[2] * x + frame[3] * y
    low_u = high_u = low_v = high_v = largest = 0.0
    if positions.size:
        low_u, high_u, low_v, high_v = (float(one) for one in (u.min(), u.max(), v.min(), v.max()))
        largest = float(np.abs(points[:, :2]).max())
    # A sparse cloud of great extent gets larger cells, so that there are not many more than points.
    cell, limit = 1.0, max(_MAX_CELLS, _MAX_CELLS_PER_POINT * len(points))
    while ((high_u - low_u) / cell + 1) * ((high_v - low_v) / cell + 1) > limit:
        cell *= 2.0
    n_columns, n_rows = int((high_u - low_u) / cell) + 1, int((high_v - low_v) / cell) + 1
    column = np.minimum((u - low_u) / cell, n_columns - 1.0).astype(np.int64)
    row = np.minimum((v - low_v) / cell, n_rows - 1.0).astype(np.int64)
    rows, first = rows_by_group(row * n_columns + column, n_columns * n_rows)
    x, y = x[rows], y[rows]
    is_disc = pattern.is_isotropic and not is_rectangle
    return PointGrid(x, y, first, n_columns, n_rows, cell, low_u, low_v, *frame, is_disc, _ROUNDING * largest)


@inner_kernel
def column_of(grid, x, y):  # type: ignore[no-untyped-def]
    """Return the column of a place, limited to the grid's."""
    u = (grid.ux * x + grid.uy * y - grid.west) / grid.cell
    return np.int64(max(0.0, min(u, grid.n_columns - 1.0)))


@inner_kernel
def row_of(grid, x, y):  # type: ignore[no-untyped-def]
    """Return the row of a place, limited to the grid's."""
    v = (grid.vx * x + grid.vy * y - grid.south) / grid.cell
    return np.int64(max(0.0, min(v, grid.n_rows - 1.0)))


@kernel
def cells_within(grid, x, y, span):  # type: ignore[no-untyped-def]
    """Return the first and last row and the first and last column of the cells within `span` of a place."""
    u = grid.ux * x + grid.uy * y - grid.west
    v = grid.vx * x + grid.vy * y - grid.south
    top, right = grid.n_rows - 1.0, grid.n_columns - 1.0
    return (
        np.int64(max(0.0, min((v - span) / grid.cell, top))),
        np.int64(max(0.0, min((v + span) / grid.cell, top))),
        np.int64(max(0.0, min((u - span) / grid.cell, right))),
        np.int64(max(0.0, min((u + span) / grid.cell, right))),
    )


@inner_kernel
def span_of(grid, dx, dy):  # type: ignore[no-untyped-def]
    """Return how many times the neighbourhood has to be enlarged for its rim to pass a place (dx, dy) off."""
    u, v = grid.ux * dx + grid.uy * dy, grid.vx * dx + grid.vy * dy
    if grid.is_disc:
        return math.sqrt(u * u + v * v)
    return max(abs(u), abs(v))


def misplaced(grid: PointGrid, ring: NDArray[np.int64], wrong_inside: bool) -> NDArray[np.int64]:
    """Return the rows of the points inside a ring, or of those outside; points on the ring are in neither."""
    places = np.column_stack((grid.x, grid.y))
    polygon = shapely.Polygon(places[ring])
    rows = np.flatnonzero(inside(places, polygon) == wrong_inside)
    is_vertex = np.zeros(len(grid.x), dtype=bool)
    is_vertex[ring] = True
    rows = rows[~is_vertex[rows]]
    margin = _ON_RING / max(math.hypot(grid.ux, grid.uy), math.hypot(grid.vx, grid.vy))
    return rows[~shapely.dwithin(polygon.exterior, shapely.points(places[rows]), margin)]


def inside(places: NDArray[np.float64], polygon: shapely.Polygon) -> NDArray[np.bool_]:
    """Tell which places, shape (n, 2), a polygon contains; those on its rings are not inside."""
    shapely.prepare(polygon)
    return np.asarray(shapely.contains_xy(polygon, places))


def holds(grid: PointGrid, ring: NDArray[np.int64], x: float, y: float) -> bool:
    """Whether a place lies inside a ring that was walked with it on the empty side."""
    bx, by = grid.x[ring] - x, grid.y[ring] - y
    ax, ay = np.roll(bx, 1), np.roll(by, 1)
    across = (ay > 0) != (by > 0)
    crossing = ax[across] - ay[across] / (by[across] - ay[across]) * (bx[across] - ax[across])
    is_inside = np.count_nonzero(crossing > 0) % 2 == 1
    return bool(is_inside and (ax * by - bx * ay).sum() * grid.orientation > 0)
