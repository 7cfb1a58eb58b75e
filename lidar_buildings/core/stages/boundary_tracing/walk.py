"""The walk round a cloud of points: a convex hull's, confined to a neighbourhood, never crossing its way."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.stages.boundary_tracing.point_grid import (
    PointGrid,
    cells_within,
    column_of,
    row_of,
    span_of,
)

#: Room for entries at first, plus so much per position; wide margin: it doubles where needed.
_ROOM, _ROOM_PER_POSITION = 256, 4
#: How the neighbourhood grows at a point from which no step is possible.
GROWTH = 1.5
#: How a walk may end: back at the start, without a way on, without room for its edges, too long.
CLOSED, STUCK, NO_ROOM, ASTRAY = 0, 1, 2, 3
#: Turns are compared in these units, about 1e-9 rad: of points in one direction the nearest is taken.
_TURN_UNIT = 2.0**-30
_FULL_TURN = 4 * 2**30


class EdgeCells(NamedTuple):
    """For every cell a list of the edges whose bounding box, in the grid's frame, meets it."""

    head: NDArray[np.int64]  #: the newest entry of each cell, −1 = none, shape (n_cells,)
    #: Of each entry: the next older one of its cell, the position at which its edge begins, and its cell,
    #: shape (room,).
    link: NDArray[np.int64]
    owner: NDArray[np.int64]
    cell: NDArray[np.int64]
    size: NDArray[np.int64]  #: number of entries, shape (1,)


def empty_edge_cells(grid: PointGrid) -> EdgeCells:
    """Return the lists of a grid without edges."""
    room = _ROOM + _ROOM_PER_POSITION * len(grid.x)
    head = np.full(len(grid.first) - 1, -1, dtype=np.int64)
    link, owner, cell = (np.empty(room, dtype=np.int64) for _ in range(3))
    return EdgeCells(head, link, owner, cell, np.zeros(1, dtype=np.int64))


def with_more_room(edges: EdgeCells) -> EdgeCells:
    """Return the same lists with room for twice as many entries."""
    link, owner, cell = (np.concatenate([each, each]) for each in (edges.link, edges.owner, edges.cell))
    return EdgeCells(edges.head, link, owner, cell, edges.size)


@kernel
def add_edge(grid, edges, a, b):  # type: ignore[no-untyped-def]
    """Enter the edge from a to b into its cells; False, and nothing done, if there is no room for it."""
    low_row, high_row, low_column, high_column = _box(grid, a, b)
    k = edges.size[0]
    if k + (high_row - low_row + 1) * (high_column - low_column + 1) > len(edges.link):
        return False
    for row in range(low_row, high_row + 1):
        for column in range(low_column, high_column + 1):
            cell = row * grid.n_columns + column
            edges.link[k], edges.owner[k], edges.cell[k] = edges.head[cell], a, cell
            edges.head[cell] = k
            k += 1
    edges.size[0] = k
    return True


@kernel
def remove_edges(edges, size):  # type: ignore[no-untyped-def]
    """Take out the newest entries until `size` are left."""
    for k in range(edges.size[0] - 1, size - 1, -1):
        edges.head[edges.cell[k]] = edges.link[k]
    edges.size[0] = size


@kernel
def meets_edges(grid, edges, follower, a, b):  # type: ignore[no-untyped-def]
    """Whether the segment ab crosses or touches an edge, beyond sharing its ends."""
    x, y, rounding, head, link, owner = (grid.x, grid.y, grid.rounding, edges.head, edges.link, edges.owner)
    # What is in the way mostly begins near a: a stuck walk has tried hundreds of segments in vain.
    home = row_of(grid, x[a], y[a]) * grid.n_columns + column_of(grid, x[a], y[a])
    if _meets_list(x, y, rounding, follower, link, owner, head[home], a, b):
        return True
    low_row, high_row, low_column, high_column = _box(grid, a, b)
    for row in range(low_row, high_row + 1):
        for cell in range(row * grid.n_columns + low_column, row * grid.n_columns + high_column + 1):
            if cell != home and _meets_list(x, y, rounding, follower, link, owner, head[cell], a, b):
                return True
    return False


@kernel
def _meets_list(x, y, rounding, follower, link, owner, k, a, b):  # type: ignore[no-untyped-def]
    """Whether the segment ab meets one of the edges in the list that begins with the entry k."""
    west, east = min(x[a], x[b]) - rounding, max(x[a], x[b]) + rounding
    south, north = min(y[a], y[b]) - rounding, max(y[a], y[b]) + rounding
    while k >= 0:
        c = owner[k]
        d = follower[c]
        is_apart = (x[c] < west and x[d] < west) or (x[c] > east and x[d] > east)
        is_apart |= (y[c] < south and y[d] < south) or (y[c] > north and y[d] > north)
        if not is_apart and _meet(x, y, rounding, a, b, c, d):
            return True
        k = link[k]
    return False


@kernel
def _box(grid, a, b):  # type: ignore[no-untyped-def]
    """Return the rows and columns that the bounding box of a segment extends over."""
    row_a, row_b = row_of(grid, grid.x[a], grid.y[a]), row_of(grid, grid.x[b], grid.y[b])
    column_a = column_of(grid, grid.x[a], grid.y[a])
    column_b = column_of(grid, grid.x[b], grid.y[b])
    return min(row_a, row_b), max(row_a, row_b), min(column_a, column_b), max(column_a, column_b)


@kernel
def _meet(x, y, rounding, a, b, c, d):  # type: ignore[no-untyped-def]
    """Whether the segments ab and cd, whose bounding boxes meet, have more in common than an end point."""
    is_shared_a, is_shared_b = a in (c, d), b in (c, d)
    if is_shared_a or is_shared_b:
        shared, tip, other = b, a, d if b == c else c
        if is_shared_a:
            shared, tip, other = a, b, d if a == c else c
        if tip == other:
            return True
        # Two segments from one point overlap if they leave it in the same direction.
        dot = (x[tip] - x[shared]) * (x[other] - x[shared]) + (y[tip] - y[shared]) * (y[other] - y[shared])
        return dot > 0 and (
            _side(x, y, rounding, shared, tip, other) == 0 or _side(x, y, rounding, shared, other, tip) == 0
        )
    if _side(x, y, rounding, a, b, c) * _side(x, y, rounding, a, b, d) > 0:
        return False
    return _side(x, y, rounding, c, d, a) * _side(x, y, rounding, c, d, b) <= 0


@inner_kernel
def _side(x, y, rounding, a, b, c):  # type: ignore[no-untyped-def]
    """Return the sign of c's side of the line ab: 1 left, −1 right, 0 on it as far as rounding tells."""
    dx, dy = x[b] - x[a], y[b] - y[a]
    cross = dx * (y[c] - y[a]) - dy * (x[c] - x[a])
    if abs(cross) <= rounding * (abs(dx) + abs(dy)):
        return 0
    return 1 if cross > 0 else -1


@kernel
def walk_round(grid, edges, follower, reach, max_reach, start, heading, max_steps):  # type: ignore[no-untyped-def]
    """
    Walk along the rim of a cloud, the empty side always to the same hand, until back at the start.

    Each step takes the point in the neighbourhood with the smallest clockwise turn from the direction back
    to the previous point, whose segment meets none of the rings so far (Sampath & Shan, 2007). Where no step
    is possible the neighbourhood grows. A walk ends for certain, since no point is entered twice.

    `edges`, EdgeCells, are those of earlier rings, `follower`, int64 (n_positions,), the next row in a ring,
    −1 for points of none; a ring that closes is added to both. `reach` (n_positions,) and `max_reach` are how
    many times the neighbourhood of each point is enlarged, and may be; `heading` leads from the row `start`
    into the empty side. Returned are the rows in walking order, the start once, and `CLOSED`, `STUCK` in the
    last row, `NO_ROOM`, or `ASTRAY` after `max_steps`.
    """
    ring = np.empty(min(len(follower), max_steps + 1), dtype=np.int64)
    dx, dy = heading
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
    """Return the points that a step may lead to, and their clockwise turns; the nearer first."""
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


@inner_kernel
def _direction(dx, dy):  # type: ignore[no-untyped-def]
    """Return a number from −1 to 3 that grows with the angle of a direction, without trigonometry."""
    slant = dy / (abs(dx) + abs(dy)) if dx != 0 or dy != 0 else 0.0
    return slant if dx >= 0 else 2.0 - slant


@kernel
def widen_about(grid, reach, row, max_reach):  # type: ignore[no-untyped-def]
    """Widen the reach of the points about one from which there was no way on; False where it cannot grow."""
    x, y, n = grid.x, grid.y, grid.n_columns
    about = 2.0 * reach[row]
    is_wider = False
    low_row, high_row, low_column, high_column = cells_within(grid, x[row], y[row], about)
    for line in range(low_row, high_row + 1):
        for i in range(grid.first[line * n + low_column], grid.first[line * n + high_column + 1]):
            wider = min(reach[i] * GROWTH, max_reach)
            if wider > reach[i] and span_of(grid, x[i] - x[row], y[i] - y[row]) <= about:
                reach[i] = wider
                is_wider = True
    return is_wider


def bridge_gap(
    grid: PointGrid,
    reach: NDArray[np.float64],
    wrong: NDArray[np.int64],
    ring: NDArray[np.int64],
    max_reach: float,
) -> bool:
    """
    Widen the reach where points on a ring's wrong side are nearest to it; False where it cannot grow.

    The smallest reach is sought with which a point on the wrong side and one of the ring see each other and
    have not tried it. All pairs that it suffices for get it: a wing that no walk entered is joined at its
    nearest points, and keeps its shape elsewhere.
    """
    on_ring = np.zeros(len(reach), dtype=np.bool_)
    on_ring[ring] = True
    level = 1.0
    while level < max_reach:
        level = min(level * GROWTH, max_reach)
        if _widen_pairs(grid, reach, wrong, on_ring, level):
            return True
    return False


@kernel
def _widen_pairs(grid, reach, rows, on_ring, level):  # type: ignore[no-untyped-def]
    """Raise the reach of points and the ring's points near them to a level; False if all have it."""
    n, is_wider = grid.n_columns, False
    for row in rows:
        x, y = grid.x[row], grid.y[row]
        low_row, high_row, low_column, high_column = cells_within(grid, x, y, level)
        for line in range(low_row, high_row + 1):
            for i in range(grid.first[line * n + low_column], grid.first[line * n + high_column + 1]):
                is_new = on_ring[i] and (reach[i] < level or reach[row] < level)
                if is_new and span_of(grid, grid.x[i] - x, grid.y[i] - y) <= level:
                    reach[i], reach[row] = max(reach[i], level), max(reach[row], level)
                    is_wider = True
    return is_wider
