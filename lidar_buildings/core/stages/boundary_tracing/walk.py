"""The walk round a cloud of points: a convex hull's, confined to a neighbourhood."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.stages.boundary_tracing.edge_cells import (
    EdgeCells,
    add_edge,
    meets_edges,
    remove_edges,
)
from lidar_buildings.core.stages.boundary_tracing.point_grid import PointGrid, cells_within

#: How the neighbourhood grows at a point from which no step is possible.
GROWTH = 1.5
#: How a walk may end: back at the start, without a way on, without room for its edges, too long.
CLOSED, STUCK, NO_ROOM, ASTRAY = 0, 1, 2, 3
#: Turns are compared in these units, about 1e-9 rad: of points in one direction the nearest is taken.
_TURN_UNIT = 2.0**-30
_FULL_TURN = 4 * 2**30


def walk_round(
    grid: PointGrid,
    edges: EdgeCells,
    follower: NDArray[np.int64],
    reach: NDArray[np.float64],
    max_reach: float,
    start: int,
    heading: tuple[float, float],
    max_steps: int,
) -> tuple[NDArray[np.int64], int]:
    """
    Walk along the rim of a cloud, the empty side always to the same hand, until back at the start.

    Each step takes the point in the neighbourhood with the smallest clockwise turn from the direction back
    to the previous point, whose segment meets none of the rings so far (Sampath & Shan, 2007). Where no step
    is possible the neighbourhood grows, up to `max_reach`.

    Parameters
    ----------
    grid : PointGrid
        The points.
    edges : EdgeCells
        The edges of earlier rings; those of the new ring are added if it closes.
    follower : ndarray of int64, shape (n_positions,)
        Next row in its ring for the points of rings, −1 for all others; updated likewise.
    reach, max_reach : ndarray of shape (n_positions,), float
        How many times the neighbourhood of each point is enlarged, and may be at most.
    start : int
        Row of a point on the rim.
    heading : tuple of two float
        Direction from the start into the empty side.
    max_steps : int
        A walk of more steps is given up.

    Returns
    -------
    ring : ndarray of int64
        Rows in walking order, the start first, not repeated at the end.
    end : int
        `CLOSED`, `STUCK` in the last row, `NO_ROOM`, or `ASTRAY`.
    """
    return _walk(grid, edges, follower, reach, max_reach, start, heading[0], heading[1], max_steps)


@kernel
def _walk(grid, edges, follower, reach, max_reach, start, dx, dy, max_steps):  # type: ignore[no-untyped-def]
    """Walk until back at the start or without a way on; ends for certain, since no point is entered twice."""
    ring = np.empty(min(len(follower), max_steps + 1), dtype=np.int64)
    ring[0], n, size, end = start, np.int64(1), edges.size[0], STUCK  # plain 1 is a type of its own
    while True:
        current = ring[n - 1]
        chosen = _step(
            grid, edges, follower, reach[current], max_reach, ring, n, _direction(dx, grid.orientation * dy)
        )
        if chosen < 0:
            break
        if not add_edge(grid, edges, current, chosen):
            end = NO_ROOM
            break
        follower[current] = chosen
        if chosen == start:
            return ring[:n].copy(), CLOSED
        dx, dy = grid.x[current] - grid.x[chosen], grid.y[current] - grid.y[chosen]
        ring[n] = chosen
        n += 1
        if n > max_steps:
            end = ASTRAY
            break
    for k in range(n):
        follower[ring[k]] = -1
    remove_edges(edges, size)
    return ring[:n].copy(), end


@kernel
def _step(grid, edges, follower, reach, max_reach, ring, n, back):  # type: ignore[no-untyped-def]
    """Return the next point in the smallest neighbourhood that has one, −1 if even the largest has none."""
    seen, reach = 0.0, min(reach, max_reach)
    while True:
        chosen = _step_within(grid, edges, follower, seen, reach, ring, n, back)
        if chosen >= 0 or reach >= max_reach:
            return chosen
        seen, reach = reach, min(reach * GROWTH, max_reach)


@kernel
def _step_within(grid, edges, follower, seen, reach, ring, n, back):  # type: ignore[no-untyped-def]
    """Return the point with the smallest clockwise turn that can be stepped to, −1 if there is none."""
    rows, turns = _free_points(grid, follower, seen, reach, ring, n, back)
    for k in np.argsort(turns):
        if not meets_edges(grid, edges, follower, ring[n - 1], rows[k]):
            return rows[k]
    return -1


@kernel
def _free_points(grid, follower, seen, reach, ring, n, back):  # type: ignore[no-untyped-def]
    """
    Return the points that a step may lead to, and their clockwise turns.

    Of points in one direction the nearer one has the smaller turn, by less than a unit.
    """
    xs, ys, current, start = grid.x, grid.y, ring[n - 1], ring[0] if n > 2 else ring[n - 1]
    ux, uy, vx, vy, is_disc = grid.ux, grid.uy, grid.vx, grid.vy, grid.is_disc
    orientation = grid.orientation
    x, y = xs[current], ys[current]
    low_row, high_row, low_column, high_column = cells_within(grid, x, y, reach)
    most = 0
    for row in range(low_row, high_row + 1):
        cell = row * grid.n_columns
        most += grid.first[cell + high_column + 1] - grid.first[cell + low_column]
    rows, turns, count = np.empty(most, dtype=np.int64), np.empty(most), 0
    for row in range(low_row, high_row + 1):
        cell = row * grid.n_columns
        for i in range(grid.first[cell + low_column], grid.first[cell + high_column + 1]):
            dx, dy = xs[i] - x, ys[i] - y
            u, v = ux * dx + uy * dy, vx * dx + vy * dy
            span = u * u + v * v if is_disc else max(u * u, v * v)
            if span > reach * reach or span <= seen * seen or (follower[i] >= 0 and i != start):
                continue
            slant = orientation * dy / (abs(dx) + abs(dy))
            angle = back - (slant if dx >= 0 else 2.0 - slant)
            turn = np.int64((angle if angle >= 0 else angle + 4.0) / _TURN_UNIT + 0.5)
            rows[count] = i
            turns[count] = (turn if turn > 1 else _FULL_TURN) + 0.5 * span / (reach * reach)
            count += 1
    return rows[:count], turns[:count]


@kernel
def _direction(dx, dy):  # type: ignore[no-untyped-def]
    """Return a number from −1 to 3 that grows with the angle of a direction, without trigonometry."""
    slant = dy / (abs(dx) + abs(dy)) if dx != 0 or dy != 0 else 0.0
    return slant if dx >= 0 else 2.0 - slant
