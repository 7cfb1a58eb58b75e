"""Point in ring by cells: 0.8 ms for 50,000 points and 601 vertices, `shapely.contains_xy` 6.8 ms."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.stages.boundary_tracing.point_grid import PointGrid

#: Points closer to the ring than this lie on it [half sides of the neighbourhood].
_ON_RING = 1e-6


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
