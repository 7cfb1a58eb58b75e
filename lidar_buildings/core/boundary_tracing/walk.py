"""
The walk round a cloud of points: a convex hull's, confined to a neighbourhood.

"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

#: How the neighbourhood grows at a point from which no step is possible.
_GROWTH = 1.5
#: Turns that differ by less are the same, and the nearer point is taken [rad].
_SAME_TURN = 1e-9
_NOT_A_STEP = -1


@dataclass(frozen=True, eq=False)
class Ground:
    """
    Where a walk takes place: distinct positions, sorted into cells.

    Attributes
    ----------
    xy : ndarray of shape (n_points, 2)
        Cell by cell, row by row [m].
    number : ndarray of int64, shape (n_points,)
        Number of each point's cell, rising.
    n_columns : int
        Cells in a row.
    cell : float
        Side of a cell [m].
    corner : ndarray of shape (2,)
        South-western corner of cell 0 [m].

    """

    xy: NDArray[np.float64]
    number: NDArray[np.int64]
    n_columns: int
    cell: float
    corner: NDArray[np.float64]


def prepare_ground(positions: NDArray[np.float64], reach: float) -> Ground:
    """
    Sort distinct positions into cells of the neighbourhood's radius.

    The order of the positions does not matter: within a cell they are ordered by x, then y.

    """
    corner = positions.min(axis=0)
    # An enormous extent gets larger cells, so that their numbers fit an integer.
    cell = max(reach, float(np.ptp(positions, axis=0).max()) / 2.0**30)
    column, row = np.floor((positions - corner) / cell).astype(np.int64).T
    n_columns = int(column.max()) + 1
    number = row * n_columns + column
    order = np.lexsort((positions[:, 1], positions[:, 0], number))
    return Ground(np.ascontiguousarray(positions[order]), number[order], n_columns, cell, corner)


def walk_round(
    ground: Ground,
    start: int,
    heading: float,
    reach: NDArray[np.float64],
    max_reach: float,
    follower: NDArray[np.int64],
) -> tuple[NDArray[np.int64], bool]:
    """
    Walk from a rim point along the rim of a cloud, the empty side to the left, until back at the start.

    Each step takes the point within reach with the smallest clockwise turn from the direction back to the
    previous point, whose segment meets none of the rings so far (Sampath & Shan, 2007). Where no step is
    possible the reach grows, up to `max_reach`.

    Parameters
    ----------
    ground : Ground
        The points.
    start : int
        Row of a point on the rim.
    heading : float
        Direction from the start into the empty side [rad].
    reach : ndarray of shape (n_points,)
        Radius of the neighbourhood round each point [m].
    max_reach : float
        Largest radius [m].
    follower : ndarray of int64, shape (n_points,)
        Next row in its ring for the points of earlier rings, −1 for all others. Extended by the new ring
        if it closes, otherwise left as it was.

    Returns
    -------
    ring : ndarray of int64
        Rows in walking order, the start first, not repeated at the end.
    closed : bool
        False if the walk ended in its last point without a way on.

    """
    return _walk(
        ground.xy,
        ground.number,
        ground.n_columns,
        ground.cell,
        ground.corner,
        start,
        heading,
        reach,
        max_reach,
        follower,
    )


@njit(cache=True, nogil=True)
def _walk(xy, number, n_columns, cell, corner, start, heading, reach, max_reach, follower):  # type: ignore[no-untyped-def]
    """
    Walk until back at the start or without a way on; ends for certain, since no point is entered twice.

    """
    ring = [start]
    longest = 0.0
    for row in range(len(xy)):
        if follower[row] >= 0:
            longest = max(longest, _distance(xy, row, follower[row]))
    current = start
    while True:
        radius = reach[current]
        chosen = _NOT_A_STEP
        while chosen == _NOT_A_STEP and radius <= max_reach:
            chosen = _next_step(xy, number, n_columns, cell, corner, ring, heading, radius, longest, follower)
            radius *= _GROWTH
        if chosen == _NOT_A_STEP:
            break
        follower[current] = chosen
        longest = max(longest, _distance(xy, current, chosen))
        if chosen == start:
            return np.array(ring), True
        heading = np.arctan2(xy[current, 1] - xy[chosen, 1], xy[current, 0] - xy[chosen, 0])
        ring.append(chosen)
        current = chosen
    for row in ring:
        follower[row] = _NOT_A_STEP
    return np.array(ring), False


@njit(cache=True, nogil=True)
def _next_step(xy, number, n_columns, cell, corner, ring, heading, radius, longest, follower):  # type: ignore[no-untyped-def]
    """
    Return the point with the smallest clockwise turn that can be stepped to, or `_NOT_A_STEP`.

    """
    current = ring[-1]
    rows, turns, distances = _within_reach(
        xy, number, n_columns, cell, corner, ring, heading, radius, follower
    )
    for _ in range(len(rows)):
        best = 0
        for k in range(1, len(rows)):
            difference = turns[k] - turns[best]
            if difference < -_SAME_TURN or (difference <= _SAME_TURN and distances[k] < distances[best]):
                best = k
        if turns[best] == np.inf:
            break
        if not _meets_ring(xy, number, n_columns, cell, corner, current, rows[best], longest, follower):
            return rows[best]
        turns[best] = np.inf
    return _NOT_A_STEP


@njit(cache=True, nogil=True)
def _within_reach(xy, number, n_columns, cell, corner, ring, heading, radius, follower):  # type: ignore[no-untyped-def]
    """
    Return the points that may be stepped to: their rows, clockwise turns in (0, 2π] and distances.

    """
    current, start = ring[-1], ring[0]
    rows = [np.int64(0) for _ in range(0)]
    turns = [0.0 for _ in range(0)]
    distances = [0.0 for _ in range(0)]
    x, y = xy[current]
    first_row, last_row = _cells(y - corner[1], radius, cell)
    first_column, last_column = _cells(x - corner[0], radius, cell)
    last_column = min(last_column, n_columns - 1)
    for line in range(first_row, last_row + 1):
        i = np.searchsorted(number, line * n_columns + first_column)
        end = line * n_columns + last_column
        while i < len(number) and number[i] <= end:
            is_free = follower[i] == _NOT_A_STEP and i != current
            if is_free or (i == start and len(ring) >= 3):
                distance = _distance(xy, current, i)
                if distance <= radius:
                    turn = (heading - np.arctan2(xy[i, 1] - y, xy[i, 0] - x)) % (2 * np.pi)
                    # Straight back is the last thing to try.
                    rows.append(i)
                    turns.append(turn if turn > _SAME_TURN else 2 * np.pi)
                    distances.append(distance)
            i += 1
    return rows, turns, distances


@njit(cache=True, nogil=True)
def _meets_ring(xy, number, n_columns, cell, corner, current, target, longest, follower):  # type: ignore[no-untyped-def]
    """
    Whether the segment from `current` to `target` crosses or touches a ring, beyond sharing its ends.

    """
    x = 0.5 * (xy[current, 0] + xy[target, 0]) - corner[0]
    y = 0.5 * (xy[current, 1] + xy[target, 1]) - corner[1]
    far = 0.5 * _distance(xy, current, target) + longest
    first_row, last_row = _cells(y, far, cell)
    first_column, last_column = _cells(x, far, cell)
    last_column = min(last_column, n_columns - 1)
    for line in range(first_row, last_row + 1):
        i = np.searchsorted(number, line * n_columns + first_column)
        end = line * n_columns + last_column
        while i < len(number) and number[i] <= end:
            if follower[i] >= 0 and _meet(xy, current, target, i, follower[i]):
                return True
            i += 1
    return False


@njit(cache=True, nogil=True)
def _meet(xy, a, b, c, d):  # type: ignore[no-untyped-def]
    """
    Whether the segments ab and cd have more in common than an end point.

    """
    if a in (c, d) or b in (c, d):
        shared, tip, other = b, a, d if b == c else c
        if a in (c, d):
            shared, tip, other = a, b, d if a == c else c
        if tip == other:
            return True
        # Two segments from one point overlap if they leave it in the same direction.
        dot = (xy[tip, 0] - xy[shared, 0]) * (xy[other, 0] - xy[shared, 0])
        dot += (xy[tip, 1] - xy[shared, 1]) * (xy[other, 1] - xy[shared, 1])
        return dot > 0 and _side(xy, shared, tip, other) == 0
    if max(xy[a, 0], xy[b, 0]) < min(xy[c, 0], xy[d, 0]) or max(xy[c, 0], xy[d, 0]) < min(xy[a, 0], xy[b, 0]):
        return False
    if max(xy[a, 1], xy[b, 1]) < min(xy[c, 1], xy[d, 1]) or max(xy[c, 1], xy[d, 1]) < min(xy[a, 1], xy[b, 1]):
        return False
    return _side(xy, a, b, c) * _side(xy, a, b, d) <= 0 and _side(xy, c, d, a) * _side(xy, c, d, b) <= 0


@njit(cache=True, nogil=True)
def _side(xy, a, b, c):  # type: ignore[no-untyped-def]
    """
    Return the sign of c's side of the line ab: 1 left, −1 right, 0 on it.

    """
    return np.sign(
        (xy[b, 0] - xy[a, 0]) * (xy[c, 1] - xy[a, 1]) - (xy[b, 1] - xy[a, 1]) * (xy[c, 0] - xy[a, 0])
    )


@njit(cache=True, nogil=True)
def _cells(position, radius, cell):  # type: ignore[no-untyped-def]
    """
    Return the first and last cell, along one axis, of an interval about a position.

    """
    return max(np.int64(np.floor((position - radius) / cell)), 0), np.int64(
        np.floor((position + radius) / cell)
    )


@njit(cache=True, nogil=True)
def _distance(xy, a, b):  # type: ignore[no-untyped-def]
    """
    Return the distance of two points [m].

    """
    return np.hypot(xy[a, 0] - xy[b, 0], xy[a, 1] - xy[b, 1])
