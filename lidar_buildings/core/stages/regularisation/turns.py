"""The division as published: a segment ends where the ring's edges change their slope."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.stages.regularisation.samples import RingSamples
from lidar_buildings.core.surfaces.ring_division.division import FREE, Division
from lidar_buildings.core.surfaces.ring_division.moments import normal_angle, running_sums, scatter_of


def divide_at_turns(ring: RingSamples, max_turn: float) -> tuple[RingSamples, Division]:
    """
    Divide a ring into segments of consecutive edges with similar slopes (Sampath & Shan, 2007).

    An edge that deviates from the edge before by more than the given angle [rad] begins the next segment. The
    point between two segments is of both, and twice among the samples returned. All walls are free, and the
    cost is 0: nothing was weighed.
    """
    n = len(ring.points)
    begins = _turns(ring.points, max_turn)
    times = np.ones(n, dtype=np.int64)
    times[begins % n] = 2
    every = np.repeat(np.arange(n), times)
    samples = replace(
        ring,
        points=ring.points[every],
        weights=ring.weights[every],
        bears=ring.bears[every],
        rows=ring.rows[every],
    )
    first = (np.cumsum(times) - 1)[begins % n] + begins // n * len(every)
    last = np.append(first[1:], first[0] + len(every))
    return samples, Division(first, last, np.full(len(first), FREE), 0.0)


def along_nearest(ring: RingSamples, division: Division, angles: NDArray[np.float64]) -> Division:
    """
    Let each segment go along the nearest to its own of some directions, given by normals; its own without.
    """
    sums = running_sums(ring.points, ring.weights)
    return replace(division, kind=_nearest(sums, division.first, division.last, angles))


@kernel
def _turns(points, max_turn):  # type: ignore[no-untyped-def]
    """Return the first point of each segment, from the sharpest turn of the ring on."""
    n = len(points)
    sharpest, start = -1.0, 0
    for i in range(n):
        turn = _between(points, (i - 1) % n, i, i, (i + 1) % n)
        if turn > sharpest:
            sharpest, start = turn, i
    first = [start]
    for i in range(start + 1, start + n):
        if _between(points, (i - 1) % n, i % n, i % n, (i + 1) % n) > max_turn:
            first.append(i)
    return np.array(first)


@kernel
def _between(points, a, b, c, d):  # type: ignore[no-untyped-def]
    """Return the angle between the ways from a to b and from c to d, 0 to π [rad]."""
    ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    vx, vy = points[d, 0] - points[c, 0], points[d, 1] - points[c, 1]
    return abs(np.arctan2(ux * vy - uy * vx, ux * vx + uy * vy))


@kernel
def _nearest(sums, first, last, angles):  # type: ignore[no-untyped-def]
    """Return the direction that is nearest to each segment's own, `FREE` if there are none."""
    kind = np.full(len(first), FREE)
    for i in range(len(first)):
        _, _, _, xx, xy, yy = scatter_of(sums, first[i], last[i])
        own, smallest = normal_angle(xx, xy, yy), np.inf
        for k in range(len(angles)):
            difference = abs((own - angles[k] + 0.5 * np.pi) % np.pi - 0.5 * np.pi)
            if difference < smallest:
                kind[i], smallest = k, difference
    return kind
