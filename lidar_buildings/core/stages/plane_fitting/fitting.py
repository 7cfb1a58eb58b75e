"""The planes of one building."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.model.bounds import checked_spacing
from lidar_buildings.core.model.point_array import checked_points, extent_of
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.neighbours.point_spacing import FEW_PROBES, measure_spacing
from lidar_buildings.core.stages.plane_fitting.config import PlaneFittingConfig
from lidar_buildings.core.stages.plane_fitting.connected import connected_planes
from lidar_buildings.core.stages.plane_fitting.fuzzy_clusters import fuzzy_planes
from lidar_buildings.core.stages.plane_fitting.model_selection import plane_sums
from lidar_buildings.core.stages.plane_fitting.open3d_planes import open3d_planes
from lidar_buildings.core.stages.plane_fitting.ransac import ransac_planes
from lidar_buildings.core.surfaces.roof_planes import RoofPlane, centroids_and_scatters, fitted_planes

#: Method → how it numbers the planes of points near the origin.
METHODS = {
    "connected": connected_planes,
    "ransac": ransac_planes,
    "fuzzy_k_means": fuzzy_planes,
    "open3d": open3d_planes,
}
#: The largest number that `plane_id` can hold.
MAX_PLANES = 65535
#: Points whose variance across a line is no larger than this, relative to that along, are on it.
_LINE = 1e-12


@dataclass(frozen=True, eq=False)
class RoofPlanes:
    """The planes of one building."""

    #: Number of each point's plane, 0 = none; the largest plane is number 1, shape (n_points,).
    plane_id: NDArray[np.uint16]
    planes: tuple[RoofPlane, ...]  #: plane number k is ``planes[k - 1]``
    status: BuildingStatus = BuildingStatus.OK  #: DEGENERATE where the points are too few or lie on a line
    reason: str = ""  #: why there are no planes; empty if there are


def fit_roof_planes(
    points: ArrayLike, config: PlaneFittingConfig | None = None, *, point_spacing: float | None = None
) -> RoofPlanes:
    """
    Find the roof planes of one building.

    Planes are found by samples of near points (RANSAC, Fischler and Bolles 1981) as connected sets of points
    whose surroundings lie along them; then they compete: points move to the plane that they are nearest to,
    and planes join or dissolve wherever the points are described as well without them (an energy of fit,
    smoothness and number of planes as of Isack and Boykov 2012). With the method ``"ransac"``, planes are
    taken out of all points one after the other (Mancera-Taboada et al. 2012); with ``"fuzzy_k_means"`` they
    are clusters of normals (Sampath & Shan 2010); with ``"open3d"`` that library's RANSAC finds them.

    - `points`, shape (n_points, 3): The building's roof points, in any order [m].
    - `point_spacing`, optional: Spacing of the cloud that the points are of [m]; measured on the points if
      not given.

    ValueError if `points` has another shape or is not finite, or `point_spacing` is not positive. Order of
    points does not matter, nor do repetitions. Time grows with the number of points.
    """
    given = checked_points(points)
    reason = _why_degenerate(given)
    if reason:
        nothing = np.zeros(len(given), dtype=np.uint16)
        return RoofPlanes(nothing, (), BuildingStatus.DEGENERATE, reason)
    plane_id = number_planes(given, config, point_spacing=point_spacing)
    planes = fitted_planes(given, plane_id)
    return RoofPlanes(plane_id, planes, reason="" if planes else "no plane has enough points")


def number_planes(
    points: ArrayLike, config: PlaneFittingConfig | None = None, *, point_spacing: float | None = None
) -> NDArray[np.uint16]:
    """Return the `plane_id` of `fit_roof_planes` alone, which takes less time."""
    config = config or PlaneFittingConfig()
    given = checked_points(points)
    if point_spacing is not None:
        checked_spacing(point_spacing)
    if _why_degenerate(given):
        return np.zeros(len(given), dtype=np.uint16)
    near = given - extent_of(given)[0]
    spacing = point_spacing or measure_spacing(near, FEW_PROBES)
    min_points = max(config.min_plane_points, math.ceil(config.min_plane_area / spacing**2))
    return _numbered_by_size(near, METHODS[config.method](near, spacing, min_points, config))


def _why_degenerate(points: FloatArray) -> str:
    """Say in words why no plane can be fitted to points in any order, nothing if it can."""
    n_distinct = min(len(points), 1) + int(bool((points[1:] != points[:1]).any()))
    if n_distinct < 2 or len(points) < 3:
        return f"{n_distinct} distinct points: a plane needs 3"
    moments = plane_sums(points - points[0], np.ones(len(points), dtype=np.int32), 2)[1:]
    spread = np.linalg.eigvalsh(centroids_and_scatters(moments)[1][0])
    return f"all {len(points)} points lie on a line" if spread[1] <= _LINE * spread[2] else ""


def _numbered_by_size(points: FloatArray, labels: NDArray[np.int32]) -> NDArray[np.uint16]:
    """Number planes from the largest on, equal ones by their least x, y and z."""
    size = int(labels.max(initial=0)) + 1
    count = np.bincount(labels, minlength=size)
    count[0] = 0
    low = np.full((size, 3), np.inf)
    for axis in range(3):
        np.minimum.at(low[:, axis], labels, points[:, axis])
    order = np.lexsort((low[:, 2], low[:, 1], low[:, 0], -count))
    order = order[count[order] > 0][:MAX_PLANES]
    number = np.zeros(size, dtype=np.uint16)
    number[order] = np.arange(1, len(order) + 1)
    return number[labels]
