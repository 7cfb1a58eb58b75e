"""Where a ring turns: its best division into straight walls and arcs, from running sums of its points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel

#: Columns: Σw, Σwx, Σwy, Σwxx, Σwxy, Σwyy, Σwxz, Σwyz, Σwzz with z = x² + y².
N_SUMS = 9
#: A determinant smaller than this share of the squared trace belongs to points on a line.
_FLAT = 1e-9
#: Most samples of one wall: fewer the larger a ring is, so that time grows no faster than the ring. Pieces of
#: a longer wall are joined again later.
_MAX_WALL_SAMPLES, _MIN_WALL_SAMPLES, _MAX_PAIRS = 500, 60, 1_000_000
#: Fewest samples that define a direction of their own, and an arc.
_MIN_FREE_SAMPLES, _MIN_ARC_SAMPLES = 3, 6
#: Samples of an arc scatter no more than so many times the noise²: an arc through a shed's corners does.
_MAX_ARC_MISFIT = 0.7
#: Kinds of walls beside those along one of the given directions.
FREE, ARC = -1, -2


@kernel
def running_sums(points, weights):  # type: ignore[no-untyped-def]
    """
    Return the sums over the points before each, going round twice, so that stretches may pass the start.

    Row i of (2 n_points + 2, 9) is of the points before the i-th, which are about the building's centre.
    """
    n = len(points)
    sums = np.zeros((2 * n + 2, N_SUMS))
    for i in range(2 * n + 1):
        k = i % n
        x, y, w = points[k, 0], points[k, 1], weights[k]
        z = x * x + y * y
        sums[i + 1, 0] = sums[i, 0] + w
        sums[i + 1, 1] = sums[i, 1] + w * x
        sums[i + 1, 2] = sums[i, 2] + w * y
        sums[i + 1, 3] = sums[i, 3] + w * x * x
        sums[i + 1, 4] = sums[i, 4] + w * x * y
        sums[i + 1, 5] = sums[i, 5] + w * y * y
        sums[i + 1, 6] = sums[i, 6] + w * x * z
        sums[i + 1, 7] = sums[i, 7] + w * y * z
        sums[i + 1, 8] = sums[i, 8] + w * z * z
    return sums


@kernel
def scatter_of(sums, start, end):  # type: ignore[no-untyped-def]
    """Return the weight of a stretch, its middle and its scatter: sums of xx, xy, yy about the middle."""
    weight = sums[end, 0] - sums[start, 0]
    x, y = (sums[end, 1] - sums[start, 1]) / weight, (sums[end, 2] - sums[start, 2]) / weight
    xx = sums[end, 3] - sums[start, 3] - x * x * weight
    xy = sums[end, 4] - sums[start, 4] - x * y * weight
    yy = sums[end, 5] - sums[start, 5] - y * y * weight
    return weight, x, y, max(xx, 0.0), xy, max(yy, 0.0)


@kernel
def least_scatter(xx, xy, yy):  # type: ignore[no-untyped-def]
    """Return the scatter across the best line: the smaller eigenvalue."""
    return max(0.5 * (xx + yy) - math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy), 0.0)


@kernel
def normal_angle(xx, xy, yy):  # type: ignore[no-untyped-def]
    """Return the direction of the least scatter, −π/2 to π/2 and beyond by π/2 [rad]."""
    return 0.5 * np.arctan2(2.0 * xy, xx - yy) + 0.5 * np.pi


@kernel
def algebraic_circle(sums, start, end):  # type: ignore[no-untyped-def]
    """
    Return centre, radius and squared offsets of the circle with the least Σ (d² − r²)² (Kåsa, 1976).

    The offsets are those of the points from the circle to first order, (d² − r²) / 2r; radius and offsets are
    infinite where the points lie on a line.
    """
    weight, mx, my, uu, uv, vv = scatter_of(sums, start, end)
    determinant = uu * vv - uv * uv
    if determinant <= _FLAT * (uu + vv) ** 2:
        return mx, my, np.inf, np.inf
    zz_mean = uu + vv
    square = mx * mx + my * my
    z = sums[end, 3] - sums[start, 3] + sums[end, 5] - sums[start, 5]
    uz = sums[end, 6] - sums[start, 6] - mx * z - 2.0 * (mx * uu + my * uv)
    vz = sums[end, 7] - sums[start, 7] - my * z - 2.0 * (mx * uv + my * vv)
    zz = (
        sums[end, 8]
        - sums[start, 8]
        - 4.0 * (mx * mx * uu + my * my * vv + 2.0 * mx * my * uv)
        - weight * square * square
        - 4.0 * (mx * uz + my * vz)
        - 2.0 * square * zz_mean
    )
    a = 0.5 * (vv * uz - uv * vz) / determinant
    b = 0.5 * (uu * vz - uv * uz) / determinant
    squared_radius = a * a + b * b + zz_mean / weight
    residual = zz - zz_mean * zz_mean / weight - 2.0 * (a * uz + b * vz)
    return mx + a, my + b, np.sqrt(squared_radius), max(residual, 0.0) / (4.0 * squared_radius)


class Costs(NamedTuple):
    """What a division costs, in squared standard deviations of a sample of weight 1."""

    noise: float  #: standard deviation of a sample across its wall [m]
    wall: float  #: cost of a wall
    own_direction: float  #: added for a wall in none of the building's directions
    step: float  #: added for the step between two consecutive walls of nearly one direction
    arc: float = np.inf  #: added for an arc
    parallel: float = 0.0  #: sine of the largest angle between directions that are nearly one
    #: Whether weights spread samples evenly along a wall, which tells one that turns back.
    is_even: bool = True


@dataclass(frozen=True, eq=False)
class Division:
    """A closed ring's walls, in its order."""

    #: Range of each wall's samples, `last` exclusive; beyond the ring's end it goes on at its start, shape
    #: (n_walls,).
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    kind: NDArray[np.int64]  #: which of the given directions, or `FREE`, or `ARC`, shape (n_walls,)
    cost: float  #: squared offsets over noise² and the cost of the walls


def divide_ring(
    points: NDArray[np.float64],
    angles: NDArray[np.float64],
    costs: Costs,
    *,
    weights: NDArray[np.float64] | None = None,
    start: int | None = None,
) -> Division:
    """
    Divide a closed ring into walls with the least squared offsets plus the cost of the walls.

    Every division is considered, by dynamic programming over the ring's samples: a wall keeps to one of the
    given directions, or has its own, or is an arc, where that is worth its cost. The ring is divided twice,
    the second time from a corner that the first division found.

    `points` are an open ring about the building's centre, (n_samples, 2) [m]; `angles` are directions of the
    walls' normals [rad]; `weights` say how much each sample counts, 1 if not given. Where `start` names a
    sample at which a wall begins, the ring is divided once. The first wall begins within the ring's first
    round.
    """
    n = len(points)
    weights = np.ones(n) if weights is None else weights
    sums = running_sums(points, weights)
    x, y = points.T
    sense = 1.0 if x @ np.roll(y, -1) >= y @ np.roll(x, -1) else -1.0
    shift = 0 if start is None else start % n
    for _ in range(2 if start is None else 1):
        first, kind, cost = divide_chain(sums, n, shift, sense, np.cos(angles), np.sin(angles), *costs)
        first, kind = first[::-1].copy(), kind[::-1].copy()
        corners = first + shift
        # The corner farthest, along the ring, from where this division began.
        shift = int(corners[int(np.argmin(np.abs(first - n / 2)))]) % n
    last = np.append(corners[1:], corners[0] + n)
    return Division(corners, last, kind, float(cost))


@kernel
def divide_chain(  # type: ignore[no-untyped-def]
    sums, n, shift, sense, cosines, sines, noise, wall, own_direction, step, arc, parallel, is_even
):
    """
    Return first sample and kind of each wall of an open chain from `shift` on, last to first, and the cost.

    Columns are the directions, then free walls, then arcs. A wall goes one way: as far as it does not, its
    samples lie beyond its ends.
    """
    free, bow = len(cosines), len(cosines) + 1
    variance, share = noise * noise, 1.0 / (noise * noise)
    longest = min(max(_MAX_PAIRS // n, _MIN_WALL_SAMPLES), _MAX_WALL_SAMPLES)
    best = np.full((n + 1, bow + 1), np.inf)
    # Cost of everything before a wall of this kind that starts here, the wall's own included.
    entry = np.full((n + 1, bow + 1), np.inf)
    came_from = np.zeros((n + 1, bow + 1), dtype=np.int64)
    before = np.zeros((n + 1, bow + 1), dtype=np.int64)
    cheapest = np.full(n + 1, np.inf)
    entry[0] = wall
    entry[0, free] += own_direction
    entry[0, bow] += arc
    cheapest[0] = 0.0
    starts = np.zeros(n + 1, dtype=np.int64)
    least = np.zeros(n + 1)
    n_starts = 1
    is_step = np.zeros((free, free), dtype=np.bool_)
    for k in range(free):
        for other in range(free):
            is_step[k, other] = abs(cosines[k] * sines[other] - sines[k] * cosines[other]) <= parallel
    for end in range(1, n + 1):
        for s in range(n_starts):
            start = starts[s]
            weight, _, _, xx, xy, yy = scatter_of(sums, shift + start, shift + end)
            across = least_scatter(xx, xy, yy)
            straight = across * share
            least[s] = cheapest[start] + straight
            dx, dy = _chord(sums, shift + start, shift + end)
            for k in range(free):
                c, d = cosines[k], sines[k]
                cost = entry[start, k] + (c * c * xx + 2 * c * d * xy + d * d * yy) * share
                if is_even and cost < best[end, k]:
                    along = d * d * xx - 2 * c * d * xy + c * c * yy
                    cost += _beyond(weight, along, c * dy - d * dx, end - start) * share
                if cost < best[end, k]:
                    best[end, k] = cost
                    came_from[end, k] = start
            cost = entry[start, free] + straight
            if is_even and end - start >= _MIN_FREE_SAMPLES and cost < best[end, free]:
                cost += _beyond(weight, xx + yy - across, math.hypot(dx, dy), end - start) * share
            if end - start >= _MIN_FREE_SAMPLES and cost < best[end, free]:
                best[end, free] = cost
                came_from[end, free] = start
            # An arc costs more than a free wall: it has to fit better by the difference.
            if arc < np.inf and end - start >= _MIN_ARC_SAMPLES and straight > arc - own_direction:
                bent, is_arc = _bent(sums, shift + start, shift + end, sense, variance)
                bent *= share
                least[s] = min(least[s], cheapest[start] + bent)
                if is_arc and entry[start, bow] + bent < best[end, bow]:
                    best[end, bow] = entry[start, bow] + bent
                    came_from[end, bow] = start
        for k in range(bow + 1):
            cheapest[end] = min(cheapest[end], best[end, k])
        _enter(best[end], entry[end], before[end], is_step, wall, own_direction, step, arc)
        # A start that is beaten by a wall from here can never win again.
        kept = 0
        for s in range(n_starts):
            if least[s] < cheapest[end] + step and end - starts[s] < longest:
                starts[kept] = starts[s]
                kept += 1
        starts[kept] = end
        n_starts = kept + 1
    first, kind = _traced_back(best, came_from, before, n, free)
    return first, kind, cheapest[n]


@kernel
def _chord(sums, start, end):  # type: ignore[no-untyped-def]
    """Return the way from the first to the last sample of a stretch."""
    from_x, from_y = _middle(sums, start, start + 1)
    to_x, to_y = _middle(sums, end - 1, end)
    return to_x - from_x, to_y - from_y


@inner_kernel
def _beyond(weight, along, length, n):  # type: ignore[no-untyped-def]
    """Return what squared distances of samples beyond a wall's ends come to, as they scatter along it."""
    # Samples spread evenly from one end to the other scatter by a known share of its length: what scatters
    # more goes beyond an end and comes back.
    even = abs(length) * math.sqrt((n + 1.0) / (12.0 * max(n - 1.0, 1.0)))
    return weight * max(math.sqrt(max(along, 0.0) / weight) - even, 0.0) ** 2


@kernel
def _bent(sums, start, end, sense, variance):  # type: ignore[no-untyped-def]
    """Return the squared offsets from the best circle, and whether the stretch may be an arc of it."""
    # An arc bulges out of its ring: hollows are straight, while gaps in the points, which look like hollows,
    # may be round.
    _, _, _, offsets = algebraic_circle(sums, start, end)
    weight = sums[end, 0] - sums[start, 0]
    is_arc = offsets <= _MAX_ARC_MISFIT * variance * weight and sense * _bulge(sums, start, end) > 0.0
    return offsets, is_arc


@kernel
def _bulge(sums, start, end):  # type: ignore[no-untyped-def]
    """Return how far the middle of a stretch lies to the right of its chord, times the chord's length."""
    x, y = _middle(sums, start, end)
    from_x, from_y = _middle(sums, start, start + 1)
    dx, dy = _chord(sums, start, end)
    return dy * (x - from_x) - dx * (y - from_y)


@inner_kernel
def _middle(sums, start, end):  # type: ignore[no-untyped-def]
    weight = sums[end, 0] - sums[start, 0]
    return (sums[end, 1] - sums[start, 1]) / weight, (sums[end, 2] - sums[start, 2]) / weight


@kernel
def _enter(best, entry, before, is_step, wall, own_direction, step, arc):  # type: ignore[no-untyped-def]
    """Find, for each kind of wall that may start here, the kind of wall that it had best follow."""
    free = len(is_step)
    for k in range(free + 2):
        for last in range(free + 2):
            cost = best[last] + wall
            if k == free:
                cost += own_direction
            elif k > free:
                cost += arc
            elif last < free and is_step[k, last]:
                cost += step
            if cost < entry[k]:
                entry[k] = cost
                before[k] = last


@kernel
def _traced_back(best, came_from, before, n, free):  # type: ignore[no-untyped-def]
    """Return the walls' first samples and kinds from the last one back."""
    first = np.zeros(n, dtype=np.int64)
    kind = np.zeros(n, dtype=np.int64)
    n_walls, end, k = 0, n, 0
    for other in range(best.shape[1]):
        if best[n, other] < best[n, k]:
            k = other
    while end > 0:
        start = came_from[end, k]
        first[n_walls] = start
        kind[n_walls] = k if k < free else free - 1 - k
        n_walls += 1
        end, k = start, before[start, k]
    return first[:n_walls], kind[:n_walls]
