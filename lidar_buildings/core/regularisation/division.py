"""
Where a traced ring turns: its best division into straight walls.

"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

#: Points that one wall may have before it is divided; pieces of a longer wall are joined again later.
_MAX_WALL_POINTS = 500
#: Fewest points that define a direction of their own.
_MIN_FREE_POINTS = 3
FREE = -1


@dataclass(frozen=True)
class Costs:
    """
    What a division costs, in squared standard deviations of a ring point.

    Attributes
    ----------
    noise : float
        Standard deviation of a ring point across its wall [m].
    wall : float
        Cost of a wall.
    own_direction : float
        Added for a wall in none of the building's directions.
    step : float
        Added for the step between two consecutive walls of one direction.

    """

    noise: float
    wall: float
    own_direction: float
    step: float


@dataclass(frozen=True)
class Wall:
    """
    A run of ring points on one straight wall.

    Attributes
    ----------
    first, last : int
        Range of ring points, `last` exclusive; beyond the ring's end it goes on at its start.
    direction : int
        Which of the given directions, or `FREE`.

    """

    first: int
    last: int
    direction: int

    def rows(self, n_points: int) -> NDArray[np.int64]:
        """
        Return the rows of the wall's points in a ring of so many.

        """
        return np.arange(self.first, self.last) % n_points


def divide_ring(ring: NDArray[np.float64], angles: NDArray[np.float64], costs: Costs) -> list[Wall]:
    """
    Divide a closed ring into walls with the least squared offsets plus the cost of the walls.

    Every division is considered, by dynamic programming over the ring's points: a wall keeps to one of the
    given directions, or has its own where that is worth its cost. The ring is divided twice, the second
    time from a corner that the first division found.

    Parameters
    ----------
    ring : ndarray of shape (n_points, 2)
        Open ring about the building's centre [m].
    angles : ndarray of shape (n_directions,)
        Directions of the walls' normals [rad].
    costs : Costs
        What walls cost.

    Returns
    -------
    list of Wall
        In the ring's order.

    """
    shift = 0
    for _ in range(2):
        first, direction = _divide(
            np.roll(ring, -shift, axis=0),
            np.cos(angles),
            np.sin(angles),
            costs.noise**2,
            costs.wall,
            costs.own_direction,
            costs.step,
        )
        corners = (first + shift).tolist()
        # The corner farthest, along the ring, from where this division began.
        shift = int(corners[int(np.argmin(np.abs(first - len(ring) / 2)))]) % len(ring)
    ends = [*corners[1:], corners[0] + len(ring)]
    return [Wall(a, b, int(k)) for a, b, k in zip(corners, ends, direction, strict=True)]


@njit(cache=True, nogil=True)
def _divide(ring, cosines, sines, variance, wall_cost, own_cost, step_cost):  # type: ignore[no-untyped-def]
    """
    Return the first point and the direction of each wall of an open chain; the last class is `FREE`.

    """
    n, free = len(ring), len(cosines)
    sums = _running_sums(ring)
    best = np.full((n + 1, free + 1), np.inf)
    # Cost of everything before a wall of this direction that starts here, the wall's own included.
    entry = np.full((n + 1, free + 1), np.inf)
    came_from = np.zeros((n + 1, free + 1), dtype=np.int64)
    before = np.zeros((n + 1, free + 1), dtype=np.int64)
    cheapest = np.full(n + 1, np.inf)
    entry[0] = wall_cost
    entry[0, free] += own_cost
    cheapest[0] = 0.0
    starts = np.zeros(n + 1, dtype=np.int64)
    n_starts = 1
    for end in range(1, n + 1):
        kept = 0
        least = np.zeros(n_starts)
        for s in range(n_starts):
            start = starts[s]
            count, xx, xy, yy = _scatter(sums, start, end)
            least[s] = cheapest[start] + _least_scatter(xx, xy, yy) / variance
            for k in range(free + 1):
                if k < free:
                    c, d = cosines[k], sines[k]
                    offsets = (c * c * xx + 2 * c * d * xy + d * d * yy) / variance
                elif count >= _MIN_FREE_POINTS:
                    offsets = _least_scatter(xx, xy, yy) / variance
                else:
                    continue
                cost = entry[start, k] + offsets
                if cost < best[end, k]:
                    best[end, k] = cost
                    came_from[end, k] = start
        cheapest[end] = best[end].min()
        for k in range(free + 1):
            for last in range(free + 1):
                cost = best[end, last] + wall_cost
                if k == free:
                    cost += own_cost
                elif k == last:
                    cost += step_cost
                if cost < entry[end, k]:
                    entry[end, k] = cost
                    before[end, k] = last
        # A start that is beaten by a wall from here can never win again.
        for s in range(n_starts):
            if least[s] < cheapest[end] + step_cost and end - starts[s] < _MAX_WALL_POINTS:
                starts[kept] = starts[s]
                kept += 1
        starts[kept] = end
        n_starts = kept + 1
    return _traced_back(best, came_from, before, n, free)


@njit(cache=True, nogil=True)
def _traced_back(best, came_from, before, n, free):  # type: ignore[no-untyped-def]
    """
    Return the walls' first points and directions from the last one back.

    """
    first = np.zeros(n, dtype=np.int64)
    direction = np.zeros(n, dtype=np.int64)
    n_walls, end, k = 0, n, int(np.argmin(best[n]))
    while end > 0:
        start = came_from[end, k]
        first[n_walls] = start
        direction[n_walls] = FREE if k == free else k
        n_walls += 1
        end, k = start, before[start, k]
    return first[:n_walls][::-1].copy(), direction[:n_walls][::-1].copy()


@njit(cache=True, nogil=True)
def _running_sums(ring):  # type: ignore[no-untyped-def]
    """
    Return the sums of x, y, x², xy, y² of the points before each.

    """
    sums = np.zeros((len(ring) + 1, 5))
    for i in range(len(ring)):
        x, y = ring[i]
        sums[i + 1, 0] = sums[i, 0] + x
        sums[i + 1, 1] = sums[i, 1] + y
        sums[i + 1, 2] = sums[i, 2] + x * x
        sums[i + 1, 3] = sums[i, 3] + x * y
        sums[i + 1, 4] = sums[i, 4] + y * y
    return sums


@njit(cache=True, nogil=True)
def _scatter(sums, start, end):  # type: ignore[no-untyped-def]
    """
    Return the number of points of a wall and their scatter about their mean.

    """
    count = end - start
    x, y = sums[end, 0] - sums[start, 0], sums[end, 1] - sums[start, 1]
    xx = sums[end, 2] - sums[start, 2] - x * x / count
    xy = sums[end, 3] - sums[start, 3] - x * y / count
    yy = sums[end, 4] - sums[start, 4] - y * y / count
    return count, max(xx, 0.0), xy, max(yy, 0.0)


@njit(cache=True, nogil=True)
def _least_scatter(xx, xy, yy):  # type: ignore[no-untyped-def]
    """
    Return the scatter across the best line: the smaller eigenvalue.

    """
    return max(0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy), 0.0)
