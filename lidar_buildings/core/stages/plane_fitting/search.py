"""RANSAC among near points: hypotheses drawn from seeds, grown, and compared by their consensus sets."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.stages.plane_fitting.surroundings import Cloud
from lidar_buildings.core.surfaces.plane_geometry import distance_of, fitted_plane, plane_through
from lidar_buildings.core.surfaces.point_moments import N_MOMENTS, add_point

#: Probability that the samples hold one free of gross errors (Mancera-Taboada et al. 2012, section II.D).
PROBABILITY = 0.95


class Limits(NamedTuple):
    """What a plane has to satisfy."""

    distance: float
    #: Cosine of the largest angle between a plane and a point's own normal.
    normal_cosine: float
    #: Least vertical component of a plane's normal.
    min_vertical: float
    min_points: int


class Scratch(NamedTuple):
    """Arrays that are used again and again while planes grow."""

    #: Number of the growth that last visited a point.
    visit: IntArray
    #: The members of the growing plane.
    queue: IntArray
    #: Points that were a seed already: they are not worth a second try.
    tried: BoolArray
    #: Points that were drawn as seeds in this round, tried or not.
    drawn: BoolArray
    #: Numbers of the current growth, free points, free points drawn in this round, points visited in vain.
    counter: IntArray


@kernel
def samples_needed(probability: float, outlier_share: float, n_unknowns: int) -> int:
    """
    Return how many random samples hold one without gross errors with this probability.

    N = ln(1 − P) / ln(1 − (1 − ε)^U), rounded up (Mancera-Taboada et al. 2012, equation 4 and table II).
    """
    good = (1.0 - outlier_share) ** n_unknowns
    if good >= probability:
        return 1
    return math.ceil(math.log(1.0 - probability) / math.log1p(-good))


@kernel
def belongs(cloud: Cloud, limits: Limits, plane: FloatArray, i: int) -> bool:
    """Whether a point lies on a plane, and its surroundings along it."""
    if distance_of(plane, cloud.points, i) > limits.distance:
        return False
    n = cloud.normals
    return abs(plane[0] * n[i, 0] + plane[1] * n[i, 1] + plane[2] * n[i, 2]) >= limits.normal_cosine


@kernel
def propose(cloud, limits, labels, seed, samples, plane):  # type: ignore[no-untyped-def]
    """
    Write the best plane around a seed to `plane`; False if there is none through the seed.

    The seed is the first point of every sample, the others are among its free neighbours (a sample of near
    points is far likelier to lie on one plane). The sample with the best consensus among them wins, and is
    replaced by the least-squares plane of its inliers.
    """
    near = np.empty(cloud.neighbours.shape[1], np.int64)
    n = 0
    for j in cloud.neighbours[seed]:
        if j < 0:
            break
        if labels[j] == 0:
            near[n] = j
            n += 1
    best = 0.0
    trial = np.empty(4)
    for s in range(len(samples)):
        q, r = near[int(samples[s, 0] * n)], near[int(samples[s, 1] * n)]
        if n < 3 or q == r or not plane_through(cloud.points[seed], cloud.points[q], cloud.points[r], trial):
            continue
        support = 0.0
        for k in range(n):
            off = distance_of(trial, cloud.points, near[k]) / limits.distance
            support += max(0.0, 1.0 - off * off)
        if support > best:
            best = support
            for k in range(4):
                plane[k] = trial[k]
    if best == 0.0:
        return False
    x, y, z = cloud.points[seed, 0], cloud.points[seed, 1], cloud.points[seed, 2]
    moments = np.zeros(N_MOMENTS)
    add_point(moments, 0.0, 0.0, 0.0)
    for j in near[:n]:
        if distance_of(plane, cloud.points, j) <= limits.distance:
            add_point(moments, cloud.points[j, 0] - x, cloud.points[j, 1] - y, cloud.points[j, 2] - z)
    refit(moments, cloud.points[seed], plane)
    return True


@inner_kernel
def refit(moments: FloatArray, origin: FloatArray, plane: FloatArray) -> None:
    """Write the plane of sums taken about `origin` to `plane`, unless they are of points on a line."""
    if fitted_plane(moments, plane) >= 0.0:
        plane[3] -= plane[0] * origin[0] + plane[1] * origin[1] + plane[2] * origin[2]


@kernel
def grow(cloud, limits, labels, seed, plane, next_fit, scratch):  # type: ignore[no-untyped-def]
    """
    Collect the free points of a plane that hang together with the seed.

    With `next_fit` > 0, `plane` is fitted anew at so many points, each time their number has doubled, and at
    the end, so that a plane known from a few points finds its way across the roof. Returned are the number of
    points, the first of the scratch queue, and Σ (1 − (distance / limit)²) by the plane when each was met.
    """
    scratch.counter[0] += 1
    number = scratch.counter[0]
    visit, queue = scratch.visit, scratch.queue
    origin, points = cloud.points[seed], cloud.points
    x, y, z = origin[0], origin[1], origin[2]
    moments = np.zeros(N_MOMENTS)
    head, tail, score, refine = 0, 0, 0.0, next_fit > 0
    if labels[seed] == 0 and belongs(cloud, limits, plane, seed):
        queue[0], tail, visit[seed] = seed, 1, number
    while head < tail:
        i = queue[head]
        head += 1
        add_point(moments, points[i, 0] - x, points[i, 1] - y, points[i, 2] - z)
        off = distance_of(plane, points, i) / limits.distance
        score += 1.0 - off * off
        if refine and head == next_fit:
            refit(moments, origin, plane)
            next_fit *= 2
        for k in range(cloud.neighbours.shape[1]):
            j = np.int64(cloud.neighbours[i, k])
            if j < 0:
                break
            if visit[j] != number and labels[j] == 0 and belongs(cloud, limits, plane, j):
                queue[tail], visit[j] = j, number
                tail += 1
    if refine:
        refit(moments, origin, plane)
    return tail, score


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
    #: Numbers of hypotheses, and of points of the order that have had their turn as seeds.
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
    n_planes, before = 0, -1
    while n_planes > before:
        before = n_planes
        pool = Pool(
            np.empty((n, 4)),
            np.empty(n, np.int64),
            np.zeros(n),
            np.zeros(n, np.int64),
            np.full(n, -1, np.int64),
            np.zeros(2, np.int64),
        )
        scratch.drawn[:] = False
        scratch.counter[2] = 0
        while True:
            draw_seeds(cloud, limits, labels, order, samples, pool, scratch)
            best = best_of(pool)
            known = pool.score[best]
            if known <= 0.0:
                break
            # Counted anew among the free points; one with too few loses its score.
            count, score = grow(
                cloud, limits, labels, pool.seed[best], pool.plane[best], np.int64(0), scratch
            )
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
def draw_seeds(cloud, limits, labels, order, samples, pool, scratch):  # type: ignore[no-untyped-def]
    """Draw seeds until the best hypothesis is likely the largest of all."""
    best = best_of(pool)
    while pool.size[1] < len(order):
        if pool.score[best] > 0.0 and scratch.counter[2] >= samples_needed(
            PROBABILITY, max(0.0, 1.0 - pool.n_points[best] / max(1, scratch.counter[1])), np.int64(1)
        ):
            break
        seed = order[pool.size[1]]
        pool.size[1] += 1
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


@kernel
def add_hypothesis(cloud, limits, labels, seed, samples, pool, scratch):  # type: ignore[no-untyped-def]
    """Find the plane around a seed and put it into the pool if it is large enough and no wall; −1 if not."""
    at = pool.size[0]
    plane = pool.plane[at]
    if not propose(cloud, limits, labels, seed, samples, plane):
        return -1
    # It finds its way across the roof; then the points of where it came to lie are collected.
    grow(cloud, limits, labels, seed, plane, cloud.neighbours.shape[1], scratch)
    count, score = grow(cloud, limits, labels, seed, plane, np.int64(0), scratch)
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
