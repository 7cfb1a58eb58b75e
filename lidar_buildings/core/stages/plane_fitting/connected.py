"""Connected planes: found by samples of near points, settled against one another, and as many as pay."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.stages.plane_fitting.adjacency import seam_points
from lidar_buildings.core.stages.plane_fitting.config import PlaneFittingConfig
from lidar_buildings.core.stages.plane_fitting.consensus import Limits, samples_needed
from lidar_buildings.core.stages.plane_fitting.label_refinement import settle
from lidar_buildings.core.stages.plane_fitting.model_selection import economise, prices_of
from lidar_buildings.core.stages.plane_fitting.parts import split_planes
from lidar_buildings.core.stages.plane_fitting.search import extract
from lidar_buildings.core.stages.plane_fitting.surroundings import Cloud, survey_points

#: Different sets of random samples; seeds share them in turn.
_SAMPLE_SETS = 64
#: Where points are sparse, bridges may be at least this long [spacings].
_LEAST_BRIDGE = 5.0


def connected_planes(
    points: NDArray[np.float64], spacing: float, min_points: int, config: PlaneFittingConfig
) -> NDArray[np.int32]:
    """
    Number the points of each plane, 0 = none.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In any order, repetitions allowed [m].
    spacing : float
        Point spacing [m].
    min_points : int
        Fewest points of a plane.
    config : PlaneFittingConfig
    """
    if len(points) < min_points:
        return np.zeros(len(points), dtype=np.int32)
    cloud, row_of, noise = survey_points(points, config.connection_radius * spacing)
    distance = max(config.max_plane_distance, config.max_noise_ratio * noise)
    prices = prices_of(distance, noise, spacing, config.plane_cost, config.unevenness, config.grain)
    bridge = max(config.bridge, _LEAST_BRIDGE * spacing)
    labels = _extracted(cloud, distance, min_points, config)
    seam = seam_points(cloud.neighbours, labels)
    labels = economise(cloud, labels, seam, prices, bridge)
    labels = settle(cloud, labels, seam, distance, config.smoothness)
    labels = split_planes(cloud.neighbours, labels, min_points)
    # What fell apart where another plane comes between is one plane all the same.
    labels = economise(cloud, labels, seam_points(cloud.neighbours, labels), prices, bridge)
    return labels[row_of]


def _extracted(
    cloud: Cloud, distance: float, min_points: int, config: PlaneFittingConfig
) -> NDArray[np.int32]:
    """Take planes out of the cloud one after the other."""
    limits = Limits(
        distance,
        math.cos(math.radians(config.max_normal_angle_deg)),
        math.cos(math.radians(config.max_slope_deg)),
        min_points,
        config.probability,
    )
    chance = np.random.default_rng(config.random_state)
    n_samples = samples_needed(config.probability, config.outlier_share)
    samples = chance.random((_SAMPLE_SETS, n_samples, 2))
    order = chance.permutation(len(cloud.points))
    # Planes are found from the inside: what lies by ridges and rims comes last.
    order = np.concatenate([order[cloud.is_smooth[order]], order[~cloud.is_smooth[order]]])
    return extract(cloud, limits, order, samples)
