"""Connected planes: RANSAC among near points, model selection, label refinement, parts that lie apart."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.union_find import flatten, link
from lidar_buildings.core.stages.plane_fitting.adjacency import seam_points
from lidar_buildings.core.stages.plane_fitting.config import PlaneFittingConfig
from lidar_buildings.core.stages.plane_fitting.consensus import PROBABILITY, Limits, samples_needed
from lidar_buildings.core.stages.plane_fitting.label_refinement import refine_labels
from lidar_buildings.core.stages.plane_fitting.model_selection import prices_of, select_planes
from lidar_buildings.core.stages.plane_fitting.search import extract
from lidar_buildings.core.stages.plane_fitting.surroundings import Cloud, survey_points

#: Different sets of random samples, shared by the seeds in turn. Wide margin: one good set is enough.
_SAMPLE_SETS = 64
# The others are those with which `bench.planes.run` finds the planes of the roofs labelled by hand.
#: Points of a plane that are closer than this are connected [spacings].
_CONNECTION_RADIUS = 3.0
#: Points may lie off their plane by this many times the measured noise, three standard deviations.
_MAX_NOISE_RATIO = 3.0
#: Longest way between parts of one plane over points on it that belong to others [m]; or so many
#: spacings if that is more.
_BRIDGE, _MIN_BRIDGE = 2.0, 5.0
#: Weight of a point's neighbours against its distances when two planes claim it.
_SMOOTHNESS = 1.0


def connected_planes(
    points: FloatArray, spacing: float, min_points: int, config: PlaneFittingConfig
) -> NDArray[np.int32]:
    """Number the points of each plane, in any order and with repetitions; 0 = none."""
    if len(points) < min_points:
        return np.zeros(len(points), dtype=np.int32)
    cloud, row_of, noise = survey_points(points, _CONNECTION_RADIUS * spacing)
    distance = max(config.max_plane_distance, _MAX_NOISE_RATIO * noise)
    prices = prices_of(distance, noise, spacing)
    bridge = max(_BRIDGE, _MIN_BRIDGE * spacing)
    labels = _extracted(cloud, distance, min_points, config)
    seam = seam_points(cloud.neighbours, labels)
    labels = select_planes(cloud, labels, seam, prices, bridge)
    labels = refine_labels(cloud, labels, seam, distance, _SMOOTHNESS)
    labels = split_planes(cloud.neighbours, labels, min_points)
    # What fell apart where another plane comes between is one plane all the same.
    labels = select_planes(cloud, labels, seam_points(cloud.neighbours, labels), prices, bridge)
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
        PROBABILITY,
    )
    chance = np.random.default_rng(config.random_state)
    n_samples = samples_needed(PROBABILITY, config.outlier_share)
    samples = chance.random((_SAMPLE_SETS, n_samples, 2))
    order = chance.permutation(len(cloud.points))
    # Planes are found from the inside: what lies by ridges and rims comes last.
    order = np.concatenate([order[cloud.is_smooth[order]], order[~cloud.is_smooth[order]]])
    return extract(cloud, limits, order, samples)


@kernel
def split_planes(
    neighbours: NDArray[np.int32], labels: NDArray[np.int32], min_points: int
) -> NDArray[np.int32]:
    """
    Make every connected part of a plane a plane of its own; parts with too few points are dissolved.

    Neighbours are rows of near points, first those that there are, then −1.
    """
    part = connected_parts(neighbours, labels)
    size = np.zeros(len(part), np.int64)
    for i in range(len(part)):
        size[part[i]] += labels[i] > 0
    number = np.zeros(len(part), np.int32)
    n = 0
    for i in range(len(part)):
        if size[part[i]] < min_points:
            continue
        # A part is named after its lowest row, which therefore comes first.
        if part[i] == i:
            n += 1
            number[i] = n
        number[i] = number[part[i]]
    return number


@kernel
def connected_parts(neighbours: NDArray[np.int32], labels: NDArray[np.int32]) -> IntArray:
    """Return the lowest row of the connected part of one plane that each point is of."""
    part = np.arange(len(labels))
    for i in range(len(labels)):
        for j in neighbours[i]:
            if j < 0 or labels[i] == 0:
                break
            if labels[j] == labels[i] and part[j] != part[i]:
                link(part, i, j)
    flatten(part)
    return part
