"""A building's distinct positions in cells, and the neighbourhood of one."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.neighbours.scan_pattern import ScanPattern

#: Cells that the grid may have: this many or so many per point; wide margin, memory only.
_MAX_CELLS, _MAX_CELLS_PER_POINT = 4096, 4
#: Cells with more points than this are not sorted by insertion.
_LARGE_CELL = 32
#: Rounding of coordinates: points nearer to a line than this lie on it [largest coordinate].
_ROUNDING = 4e-15


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
    low_u = high_u = low_v = high_v = largest = 0.0
    if len(points):
        x, y = points[:, 0], points[:, 1]
        u, v = frame[0] * x + frame[1] * y, frame[2] * x + frame[3] * y
        low_u, high_u, low_v, high_v = (float(one) for one in (u.min(), u.max(), v.min(), v.max()))
        largest = float(np.abs(points[:, :2]).max())
    # A sparse cloud of great extent gets larger cells, so that there are not many more than points.
    cell, limit = 1.0, max(_MAX_CELLS, _MAX_CELLS_PER_POINT * len(points))
    while ((high_u - low_u) / cell + 1) * ((high_v - low_v) / cell + 1) > limit:
        cell *= 2.0
    n_columns, n_rows = int((high_u - low_u) / cell) + 1, int((high_v - low_v) / cell) + 1
    x, y, first = _sorted_by_cell(points, *frame, low_u, low_v, cell, n_columns, n_rows)
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


@inner_kernel
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


@kernel
def _sorted_by_cell(points, ux, uy, vx, vy, west, south, cell, n_columns, n_rows):  # type: ignore[no-untyped-def]
    """Return distinct positions cell by cell, and where each cell begins."""
    number = np.empty(len(points), dtype=np.int32)
    first = np.zeros(n_columns * n_rows + 1, dtype=np.int64)
    for i in range(len(points)):
        u = (ux * points[i, 0] + uy * points[i, 1] - west) / cell
        v = (vx * points[i, 0] + vy * points[i, 1] - south) / cell
        column = np.int64(max(0.0, min(u, n_columns - 1.0)))
        number[i] = np.int64(max(0.0, min(v, n_rows - 1.0))) * n_columns + column
        first[number[i] + 1] += 1
    for k in range(1, len(first)):
        first[k] += first[k - 1]
    place = first[:-1].copy()
    x, y = np.empty(len(points)), np.empty(len(points))
    for i in range(len(points)):
        x[place[number[i]]], y[place[number[i]]] = points[i, 0], points[i, 1]
        place[number[i]] += 1
    for k in range(len(first) - 1):
        _sort(x, y, first[k], first[k + 1])
    n = _drop_copies(x, y, first)
    return x[:n].copy(), y[:n].copy(), first


@inner_kernel
def _sort(x, y, begin, end):  # type: ignore[no-untyped-def]
    """Sort positions from begin to end by x, then y, in place, by steps that shrink (Shell 1959)."""
    step = 1
    while end - begin > _LARGE_CELL and 2.25 * step < end - begin:
        step = int(2.25 * step) + 1
    while step > 0:
        for i in range(begin + step, end):
            one_x, one_y = x[i], y[i]
            j = i
            while j - step >= begin and (
                x[j - step] > one_x or (x[j - step] == one_x and y[j - step] > one_y)
            ):
                x[j], y[j] = x[j - step], y[j - step]
                j -= step
            x[j], y[j] = one_x, one_y
        step = int(step / 2.25)


@inner_kernel
def _drop_copies(x, y, first):  # type: ignore[no-untyped-def]
    """Move up the positions that differ from the one before, cell by cell, and return their number."""
    n = 0
    for k in range(len(first) - 1):
        begin, end = first[k], first[k + 1]
        first[k] = n
        for i in range(begin, end):
            if i == begin or x[i] != x[n - 1] or y[i] != y[n - 1]:
                x[n], y[n] = x[i], y[i]
                n += 1
    first[-1] = n
    return n
