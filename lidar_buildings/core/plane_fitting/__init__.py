"""
Roof planes: RANSAC with connected consensus sets and least squares.

"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.least_squares_plane import least_squares_plane
from lidar_buildings.core.plane_fitting.competition import (
    join,
    rows_by_label,
    settle,
    split,
)
from lidar_buildings.core.plane_fitting.config import PlaneFittingConfig
from lidar_buildings.core.plane_fitting.consensus import Cloud, Limits, samples_needed
from lidar_buildings.core.plane_fitting.plane_geometry import local_normals
from lidar_buildings.core.plane_fitting.search import extract
from lidar_buildings.core.point_array import checked_points
from lidar_buildings.core.point_spacing import measure_spacing
from lidar_buildings.core.roof_planes import RoofPlane
from lidar_buildings.core.status import BuildingStatus

__all__ = ["PlaneFittingConfig", "RoofPlane", "RoofPlanes", "fit_roof_planes", "samples_needed"]

#: Neighbours along which planes grow: enough to bridge the unequal steps along and across the scan.
_NEIGHBOURS = 24
#: Neighbours that a point's own normal is taken from: as few as the noise allows, to blur ridges little.
_NORMAL_NEIGHBOURS = 12
#: Different sets of random samples; seeds share them in turn.
_SAMPLE_SETS = 64
#: The largest number that `plane_id` can hold.
_MAX_PLANES = 65535


@dataclass(frozen=True, eq=False)
class RoofPlanes:
    """
    The planes of one building.

    Attributes
    ----------
    plane_id : ndarray of shape (n_points,), uint16
        Number of each point's plane, 0 = none; the largest plane is number 1.
    planes : tuple of RoofPlane
        Plane number k is ``planes[k - 1]``.
    status : BuildingStatus
        DEGENERATE where the points are too few or lie on a line.
    reason : str
        Why there are no planes; empty if there are.

    """

    plane_id: NDArray[np.uint16]
    planes: tuple[RoofPlane, ...]
    status: BuildingStatus = BuildingStatus.OK
    reason: str = ""


def fit_roof_planes(points: ArrayLike, config: PlaneFittingConfig | None = None) -> RoofPlanes:
    """
    Find the roof planes of one building.

    RANSAC (Mancera-Taboada et al. 2012): the plane with the best consensus is adjusted by orthogonal least
    squares to all its points, these leave the cloud, and so on until too few are left. Unlike there,
    samples are drawn among near points and a consensus set has to be connected and to agree in its normals,
    so that planes neither join separate roof parts nor cut through others. At last every point chooses
    among the planes around it.

    Parameters
    ----------
    points : array_like of shape (n_points, 3)
        The building's roof points, in any order [m].
    config : PlaneFittingConfig, optional

    Returns
    -------
    RoofPlanes

    Raises
    ------
    ValueError
        If `points` has another shape or is not finite.

    Notes
    -----
    Order of points does not matter. Time grows with the number of points times a few; some 100 000 points
    a second.

    """
    config = config or PlaneFittingConfig()
    given = checked_points(points)
    origin = given.min(axis=0) if len(given) else np.zeros(3)
    # Sorted and without repetitions, so that neither the order nor a point recorded twice matters.
    distinct, row_of = np.unique(given - origin, axis=0, return_inverse=True)
    if _is_line(distinct):
        nothing = np.zeros(len(given), dtype=np.uint16)
        return RoofPlanes(nothing, (), BuildingStatus.DEGENERATE, _why_degenerate(distinct))
    spacing = measure_spacing(distinct)
    min_points = max(config.min_plane_points, math.ceil(config.min_plane_area / spacing**2))
    labels = _labels(distinct, spacing, min_points, config)[row_of.reshape(-1)]
    groups = sorted(
        rows_by_label(labels), key=lambda group: (-len(group[1]), tuple(given[group[1]].min(axis=0)))
    )
    plane_id = np.zeros(len(given), dtype=np.uint16)
    for number, (_, rows) in enumerate(groups[:_MAX_PLANES], start=1):
        plane_id[rows] = number
    planes = tuple(_roof_plane(given[rows]) for _, rows in groups[:_MAX_PLANES])
    reason = "" if planes else f"no plane has {min_points} points"
    return RoofPlanes(plane_id, planes, BuildingStatus.OK, reason)


def _labels(
    points: NDArray[np.float64], spacing: float, min_points: int, config: PlaneFittingConfig
) -> NDArray[np.int32]:
    """
    Number the points of each plane; `points` are distinct and in canonical order.

    """
    cloud = _cloud(points, config.connection_radius * spacing)
    limits = Limits(
        config.max_plane_distance,
        math.cos(math.radians(config.max_normal_angle_deg)),
        math.cos(math.radians(config.max_slope_deg)),
        min_points,
        config.probability,
    )
    chance = np.random.default_rng(config.random_state)
    n_samples = samples_needed(config.probability, config.outlier_share)
    samples = chance.random((_SAMPLE_SETS, n_samples, 2))
    labels = extract(cloud, limits, chance.permutation(len(points)), samples)
    for _ in range(2):
        labels = join(cloud, labels, config.max_plane_distance, config.merge_angle_deg)
        labels = settle(cloud, labels, config.max_plane_distance, config.smoothness)
        labels = split(cloud.neighbours, labels, min_points)
    return labels


def _cloud(points: NDArray[np.float64], radius: float) -> Cloud:
    """
    Gather what the search needs to know of the points.

    """
    found = cKDTree(points, balanced_tree=False).query(
        points, k=range(2, _NEIGHBOURS + 2), distance_upper_bound=radius
    )[1]
    neighbours = np.where(found < len(points), found, -1).astype(np.int32)
    return Cloud(points, local_normals(points, neighbours, _NORMAL_NEIGHBOURS), neighbours)


def _is_line(points: NDArray[np.float64]) -> bool:
    """
    Whether distinct points are fewer than three or lie on a line.

    """
    if len(points) < 3:
        return True
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] <= 1e-6 * spread[0])


def _why_degenerate(points: NDArray[np.float64]) -> str:
    """
    Say in words why no plane can be fitted.

    """
    if len(points) < 3:
        return f"{len(points)} distinct points: a plane needs 3"
    return f"all {len(points)} points lie on a line"


def _roof_plane(points: NDArray[np.float64]) -> RoofPlane:
    """
    Adjust one plane to its points, whatever their order.

    """
    ordered = points[np.lexsort(points.T)]
    normal, centroid, rms = least_squares_plane(ordered)
    return RoofPlane(normal, centroid, rms, len(points))
