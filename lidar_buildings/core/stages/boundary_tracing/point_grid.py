"""A building's distinct positions in cells, the neighbourhood of one, and which of them a ring holds."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
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
    positions = distinct_positions(points[:, 0], points[:, 1])
    x, y = positions.real, positions.imag
    u, v = frame[0] * x + frame[1] * y, frame[2] * x + frame[3] * y
    low_u = high_u = low_v = high_v = largest = 0.0
    if len(positions):
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


@kernel
def column_of(grid, x, y):  # type: ignore[no-untyped-def]
    """Return the column of a place, limited to the grid's."""
    u = (grid.ux * x + grid.uy * y - grid.west) / grid.cell
    return np.int64(max(0.0, min(u, grid.n_columns - 1.0)))


@kernel
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


@kernel
def span_of(grid, dx, dy):  # type: ignore[no-untyped-def]
    """Return how many times the neighbourhood has to be enlarged for its rim to pass a place (dx, dy) off."""
    u, v = grid.ux * dx + grid.uy * dy, grid.vx * dx + grid.vy * dy
    if grid.is_disc:
        return math.sqrt(u * u + v * v)
    return max(abs(u), abs(v))


def misplaced(grid: PointGrid, ring: NDArray[np.int64], wrong_inside: bool) -> NDArray[np.int64]:
    """
    Return the rows of the points inside a ring, or of those outside; points on the ring are in neither.

    Only points in cells that the ring passes are tested one by one, against the edges in their row of cells;
    all others share the side of their cell's centre.
    """
    x, y = grid.x[ring], grid.y[ring]
    u = (grid.ux * x + grid.uy * y - grid.west) / grid.cell
    v = (grid.vx * x + grid.vy * y - grid.south) / grid.cell
    found: NDArray[np.int64] = _misplaced(grid, u, v, wrong_inside)
    return found


@kernel
def _misplaced(grid, u, v, wrong_inside):  # type: ignore[no-untyped-def]
    margin = _ON_RING / grid.cell
    is_rim, first, edges = _edges_by_row(u, v, grid.n_columns, grid.n_rows, margin)
    inside = filled(u, v, grid.n_columns, grid.n_rows)
    found = np.empty(len(grid.x), dtype=np.int64)
    n = 0
    for row in range(grid.n_rows):
        near = edges[first[row] : first[row + 1]]
        for cell in range(row * grid.n_columns, (row + 1) * grid.n_columns):
            if not is_rim[cell] and inside[cell] != wrong_inside:
                continue
            for i in range(grid.first[cell], grid.first[cell + 1]):
                if not is_rim[cell] or _is_wrong(grid, i, u, v, near, wrong_inside, margin):
                    found[n] = i
                    n += 1
    return found[:n].copy()


@kernel
def filled(u, v, n_columns, n_rows):  # type: ignore[no-untyped-def]
    """
    Return for every cell, side 1, whether its centre lies inside a ring; row by row.

    Each edge turns over all cells to its right; so those inside are turned over an odd number of times.
    """
    inside = np.zeros(n_columns * n_rows, dtype=np.bool_)
    for a in range(len(u)):
        b = a + 1 if a + 1 < len(u) else 0
        low = np.int64(max(np.floor(min(v[a], v[b]) - 0.5), 0.0))
        high = np.int64(min(np.floor(max(v[a], v[b]) + 0.5), n_rows - 1.0))
        for row in range(low, high + 1):
            middle = row + 0.5
            if (v[a] > middle) != (v[b] > middle):
                crossing = u[a] + (middle - v[a]) / (v[b] - v[a]) * (u[b] - u[a])
                column = max(np.floor(crossing - 0.5) + 1.0, 0.0)
                if column < n_columns:
                    inside[row * n_columns + np.int64(column)] ^= True
    for row in range(n_rows):
        for cell in range(row * n_columns + 1, (row + 1) * n_columns):
            inside[cell] ^= inside[cell - 1]
    return inside


def holds(grid: PointGrid, ring: NDArray[np.int64], x: float, y: float) -> bool:
    """Whether a place lies inside a ring that was walked with it on the empty side."""
    bx, by = grid.x[ring] - x, grid.y[ring] - y
    ax, ay = np.roll(bx, 1), np.roll(by, 1)
    across = (ay > 0) != (by > 0)
    crossing = ax[across] - ay[across] / (by[across] - ay[across]) * (bx[across] - ax[across])
    is_inside = np.count_nonzero(crossing > 0) % 2 == 1
    return bool(is_inside and (ax * by - bx * ay).sum() * grid.orientation > 0)


@kernel
def _edges_by_row(u, v, n_columns, n_rows, margin):  # type: ignore[no-untyped-def]
    """Return which cells edges pass, and for every row of cells the edges that come into it."""
    is_rim = np.zeros(n_columns * n_rows, dtype=np.bool_)
    first = np.zeros(n_rows + 1, dtype=np.int64)
    low, high = np.empty(len(u), dtype=np.int64), np.empty(len(u), dtype=np.int64)
    for a in range(len(u)):
        b = a + 1 if a + 1 < len(u) else 0
        low[a], high[a] = _cells_of(v[a], v[b], margin, n_rows)
        left, right = _cells_of(u[a], u[b], margin, n_columns)
        for row in range(low[a], high[a] + 1):
            first[row + 1] += 1
            for cell in range(row * n_columns + left, row * n_columns + right + 1):
                is_rim[cell] = True
    for row in range(n_rows):
        first[row + 1] += first[row]
    place = first[:-1].copy()
    edges = np.empty(first[-1], dtype=np.int64)
    for a in range(len(u)):
        for row in range(low[a], high[a] + 1):
            edges[place[row]] = a
            place[row] += 1
    return is_rim, first, edges


@kernel
def _cells_of(a, b, margin, n):  # type: ignore[no-untyped-def]
    """Return the first and the last of n cells, of side 1, that an interval and its margin reach."""
    low = np.int64(max(0.0, min(min(a, b) - margin, n - 1.0)))
    return low, np.int64(max(0.0, min(max(a, b) + margin, n - 1.0)))


@kernel
def _is_wrong(grid, i, u, v, near, wrong_inside, margin):  # type: ignore[no-untyped-def]
    """Whether a point lies on the wrong side of a ring, and not on it, judged by the edges of its row."""
    x, y = grid.x[i], grid.y[i]
    p = (grid.ux * x + grid.uy * y - grid.west) / grid.cell
    q = (grid.vx * x + grid.vy * y - grid.south) / grid.cell
    is_inside = False
    for a in near:
        b = a + 1 if a + 1 < len(u) else 0
        if (v[a] > q) != (v[b] > q) and p < u[a] + (q - v[a]) / (v[b] - v[a]) * (u[b] - u[a]):
            is_inside = not is_inside
    if is_inside != wrong_inside:
        return False
    for a in near:
        b = a + 1 if a + 1 < len(u) else 0
        if _distance_to_edge(p - u[a], q - v[a], u[b] - u[a], v[b] - v[a]) <= margin:
            return False
    return True


@kernel
def _distance_to_edge(p, q, du, dv):  # type: ignore[no-untyped-def]
    """Return the distance of a place from the segment that leads from the origin to (du, dv)."""
    length = du * du + dv * dv
    share = min(max((p * du + q * dv) / length, 0.0), 1.0) if length > 0 else 0.0
    return math.hypot(p - share * du, q - share * dv)
