"""RANSAC as published: planes out of all points, one after the other."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray
from lidar_buildings.core.stages.plane_fitting.config import PlaneFittingConfig
from lidar_buildings.core.stages.plane_fitting.search import PROBABILITY, samples_needed
from lidar_buildings.core.surfaces.plane_geometry import distance_of, fitted_plane, plane_through
from lidar_buildings.core.surfaces.point_moments import N_MOMENTS, add_point

#: Times that a plane is adjusted to all its points at most. Wide margin: two or three mostly suffice.
_MAX_ADJUSTMENTS = 20


def ransac_planes(
    points: FloatArray, spacing: float, min_points: int, config: PlaneFittingConfig
) -> NDArray[np.int32]:
    """
    Number the points of each plane, 0 = none (Mancera-Taboada et al. 2012, section II.D).

    Of N planes through three random points the one with most points within the tolerance is adjusted to these
    by orthogonal least squares, again and again until they stay the same; they leave the cloud, and the next
    plane is sought until one has too few points. From the spacing the points of the largest plane follow;
    planes are not connected.
    """
    order = np.lexsort(points.T[::-1])
    ordered = np.ascontiguousarray(points[order])
    chance = np.random.default_rng(config.random_state)
    n_samples = samples_needed(PROBABILITY, config.outlier_share, 3)
    enough = math.ceil(config.largest_plane_area / spacing**2) or len(points)
    labels = np.zeros(len(points), dtype=np.int32)
    number = 0
    while np.count_nonzero(labels == 0) >= min_points:
        free = np.flatnonzero(labels == 0)
        samples = chance.random((n_samples, 3))
        members = best_plane(ordered[free], samples, config.max_plane_distance, enough)
        if np.count_nonzero(members) < min_points:
            break
        number += 1
        labels[free[members]] = number
    found = np.empty_like(labels)
    found[order] = labels
    return found


@kernel
def best_plane(points: FloatArray, samples: FloatArray, tolerance: float, enough: int) -> BoolArray:
    """
    Return which points lie on the adjusted plane of the sample with the best consensus.

    Samples choose three points by numbers in [0, 1); after a consensus of `enough` points no further one is
    looked at.
    """
    best, trial = np.zeros(4), np.empty(4)
    most = 0
    for s in range(len(samples)):
        p, q, r = (samples[s] * len(points)).astype(np.int64)
        if p in (q, r) or q == r or not plane_through(points[p], points[q], points[r], trial):
            continue
        n = 0
        for i in range(len(points)):
            n += distance_of(trial, points, i) <= tolerance
        if n > most:
            most = n
            for k in range(4):
                best[k] = trial[k]
        if most >= enough:
            break
    members = np.zeros(len(points), np.bool_)
    for _ in range(_MAX_ADJUSTMENTS if most >= 3 else 0):
        changed = False
        moments = np.zeros(N_MOMENTS)
        for i in range(len(points)):
            on_plane = distance_of(best, points, i) <= tolerance
            changed |= on_plane != members[i]
            members[i] = on_plane
            if on_plane:
                add_point(moments, points[i, 0], points[i, 1], points[i, 2])
        if not changed or fitted_plane(moments, best) < 0.0:
            break
    return members
