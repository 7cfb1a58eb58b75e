"""The edges of rings in the cells that they pass, so that a step's crossing is looked for nearby only."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.stages.boundary_tracing.point_grid import PointGrid, column_of, row_of

#: Room for entries at first, plus so much per position; wide margin: it doubles where needed.
_ROOM, _ROOM_PER_POSITION = 256, 4


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
    x, y, rounding, head, link, owner = (
        grid.x,
        grid.y,
        grid.rounding,
        edges.head,
        edges.link,
        edges.owner,
    )
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


@kernel
def _side(x, y, rounding, a, b, c):  # type: ignore[no-untyped-def]
    """Return the sign of c's side of the line ab: 1 left, −1 right, 0 on it as far as rounding tells."""
    dx, dy = x[b] - x[a], y[b] - y[a]
    cross = dx * (y[c] - y[a]) - dy * (x[c] - x[a])
    if abs(cross) <= rounding * (abs(dx) + abs(dy)):
        return 0
    return 1 if cross > 0 else -1
