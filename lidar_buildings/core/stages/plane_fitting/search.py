"""The search for the next best plane: hypotheses drawn from seeds, compared by their consensus sets."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.stages.plane_fitting.consensus import Limits, Scratch, grow, propose, samples_needed
from lidar_buildings.core.stages.plane_fitting.surroundings import Cloud

#: Points, per point of the cloud, that failed hypotheses may visit; from then on their points are seeds no
#: more. A roof takes a few, a heap of points that are of no plane could take as many as it has points.
_PATIENCE = 100


class Pool(NamedTuple):
    """Hypotheses that wait to be accepted, in the order in which they were found."""

    plane: FloatArray
    seed: IntArray
    #: 0 once accepted or outdated.
    score: FloatArray
    n_points: IntArray
    #: Per point the last hypothesis that it belonged to, −1 = none.
    holder: IntArray
    #: One cell: the number of hypotheses.
    size: IntArray


@kernel
def extract(cloud: Cloud, limits: Limits, order: IntArray, samples: FloatArray) -> NDArray[np.int32]:
    """
    Take planes out of the cloud one after the other until none is left with enough points; number 0 = none.

    In each round every free point is a seed, in the given random order, unless a known hypothesis holds it. A
    hypothesis is accepted once enough seeds were drawn to have met, with the wanted probability, any plane as
    large. Hypotheses are kept for later planes; since points only ever leave, a score can only fall, so the
    one with the highest score after a recount is the best of all. `samples`, shape (n_sets, n_samples, 2),
    are random numbers in [0, 1) that choose each seed's.
    """
    n = len(order)
    labels = np.zeros(n, np.int32)
    scratch = Scratch(
        np.zeros(n, np.int64),
        np.empty(n, np.int64),
        np.zeros(n, np.bool_),
        np.zeros(n, np.bool_),
        np.zeros(4, np.int64),
    )
    scratch.counter[1] = n
    n_planes: int = np.int64(0)  # type: ignore[assignment] # a plain 0 is a type of its own for numba
    before: int = np.int64(-1)  # type: ignore[assignment]
    while n_planes > before:
        before = n_planes
        pool = Pool(
            np.empty((n, 4)),
            np.empty(n, np.int64),
            np.zeros(n),
            np.zeros(n, np.int64),
            np.full(n, -1, np.int64),
            np.zeros(1, np.int64),
        )
        cursor: int = np.int64(0)  # type: ignore[assignment]
        scratch.drawn[:] = False
        scratch.counter[2] = 0
        while True:
            cursor = draw_seeds(cloud, limits, labels, order, samples, cursor, pool, scratch)
            best = best_of(pool)
            known = pool.score[best]
            if known <= 0.0:
                break
            # Counted anew among the free points; one with too few loses its score.
            count, score = grow(cloud, limits, labels, pool.seed[best], pool.plane[best], False, scratch)
            pool.n_points[best], pool.score[best] = count, score
            if count < limits.min_points:
                pool.score[best] = 0.0
            elif score >= known:
                n_planes += 1
                pool.score[best] = 0.0
                for i in scratch.queue[:count]:
                    labels[i] = n_planes
                    scratch.counter[2] -= scratch.drawn[i]
                scratch.counter[1] -= count
    return labels


@kernel
def best_of(pool: Pool) -> int:
    """Return the hypothesis with the highest score, of several the first."""
    best = 0
    for k in range(1, pool.size[0]):
        if pool.score[k] > pool.score[best]:
            best = k
    return best


@kernel
def draw_seeds(
    cloud: Cloud,
    limits: Limits,
    labels: NDArray[np.int32],
    order: IntArray,
    samples: FloatArray,
    cursor: int,
    pool: Pool,
    scratch: Scratch,
) -> int:
    """Draw seeds until the best hypothesis is likely the largest of all; return the place in `order`."""
    best = best_of(pool)
    while cursor < len(order):
        if pool.score[best] > 0.0 and scratch.counter[2] >= samples_needed(
            limits.probability, max(0.0, 1.0 - pool.n_points[best] / max(1, scratch.counter[1])), 1
        ):
            break
        seed = order[cursor]
        cursor += 1
        if labels[seed] != 0:
            continue
        scratch.drawn[seed] = True
        scratch.counter[2] += 1
        if scratch.tried[seed] or (pool.holder[seed] >= 0 and pool.score[pool.holder[seed]] > 0.0):
            continue
        scratch.tried[seed] = True
        added = add_hypothesis(cloud, limits, labels, seed, samples[seed % len(samples)], pool, scratch)
        if added >= 0 and pool.score[added] > pool.score[best]:
            best = added
    return cursor


@kernel
def add_hypothesis(
    cloud: Cloud,
    limits: Limits,
    labels: NDArray[np.int32],
    seed: int,
    samples: FloatArray,
    pool: Pool,
    scratch: Scratch,
) -> int:
    """Find the plane around a seed and put it into the pool if it is large enough and no wall; −1 if not."""
    at = pool.size[0]
    plane = pool.plane[at]
    if not propose(cloud, limits, labels, seed, samples, plane):
        return -1
    # It finds its way across the roof; then the points of where it came to lie are collected.
    grow(cloud, limits, labels, seed, plane, True, scratch)
    count, score = grow(cloud, limits, labels, seed, plane, False, scratch)
    if count < limits.min_points or plane[2] < limits.min_vertical:
        scratch.counter[3] += count
        if scratch.counter[3] > _PATIENCE * len(labels):
            for i in scratch.queue[:count]:
                scratch.tried[i] = True
        return -1
    pool.seed[at], pool.n_points[at], pool.score[at] = seed, count, score
    for i in scratch.queue[:count]:
        pool.holder[i] = at
    pool.size[0] += 1
    return at
