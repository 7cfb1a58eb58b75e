"""
Ways to find the planes of roofs that are compared: this package's and those of libraries.

A peer is taken in if `pip` installs it from a wheel on Linux with Python 3.11 and its licence is permissive.

============  =========  ====================================================================================
package       licence    verdict
============  =========  ====================================================================================
open3d        MIT        taken: ``segment_plane`` (RANSAC), plane by plane, the largest cluster (DBSCAN) of
                         its inliers each time; and ``detect_planar_patches`` (Araújo and Oliveira 2020)
CGAL          GPL        left out: the licence
pyransac3d    Apache-2   left out: the same RANSAC in Python, slower
============  =========  ====================================================================================
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.stages.plane_fitting.config import AS_PUBLISHED, PlaneFittingConfig
from lidar_buildings.core.stages.plane_fitting.fitting import fit_roof_planes

#: What was best on the labelled roofs: tolerance [m], samples, reach of clusters [m], fewest points.
TUNED = {"tolerance": 0.2, "n_samples": 1000, "reach": 1.5, "fewest": 30}
#: The defaults of Open3D's function; every plane is the whole set of inliers.
UNTUNED = {"tolerance": 0.01, "n_samples": 100, "reach": 0.0, "fewest": 3}
#: Planes sought on one roof at most.
MOST_PLANES = 60


class Method(NamedTuple):
    """A way to find planes."""

    #: Points → number of each point's plane, 0 = none.
    find: Callable[[NDArray[np.float64]], NDArray[np.int64]]
    package: str = "lidar_buildings"  #: what has to be importable

    @property
    def installed(self) -> bool:
        """Whether the package is there."""
        return importlib.util.find_spec(self.package) is not None


def own_method(config: PlaneFittingConfig) -> Method:
    """Return this package's planes with these parameters."""
    return Method(lambda points: fit_roof_planes(points, config).plane_id.astype(np.int64))


def open3d_ransac(
    points: NDArray[np.float64], tolerance: float, n_samples: int, reach: float, fewest: int
) -> NDArray[np.int64]:
    """
    Take planes out one after the other; of each only the largest cluster of inliers if there is a `reach`.
    """
    import open3d

    open3d.utility.random.seed(0)
    plane_id = np.zeros(len(points), dtype=np.int64)
    for number in range(1, MOST_PLANES + 1):
        free = np.flatnonzero(plane_id == 0)
        if len(free) < max(fewest, 3):
            break
        cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points[free]))
        rows = np.asarray(cloud.segment_plane(tolerance, 3, n_samples)[1], dtype=np.int64)
        if reach > 0.0 and len(rows):
            label = np.asarray(cloud.select_by_index(rows).cluster_dbscan(reach, 5))
            rows = rows[label == np.bincount(label[label >= 0]).argmax()] if (label >= 0).any() else rows[:0]
        if len(rows) < fewest:
            break
        plane_id[free[rows]] = number
    return plane_id


def open3d_patches(points: NDArray[np.float64], **settings: Any) -> NDArray[np.int64]:
    """Detect planar patches, and give each the points inside its box that no larger one has."""
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(30))
    boxes = cloud.detect_planar_patches(search_param=open3d.geometry.KDTreeSearchParamKNN(30), **settings)
    inside = [np.asarray(box.get_point_indices_within_bounding_box(cloud.points)) for box in boxes]
    plane_id = np.zeros(len(points), dtype=np.int64)
    for number, rows in enumerate(sorted(inside, key=len), start=1):
        plane_id[rows] = number
    return plane_id


#: Name → method, this package's first.
METHODS = {
    "lidar_buildings": own_method(PlaneFittingConfig()),
    "as published": own_method(AS_PUBLISHED),
    "open3d ransac, tuned": Method(lambda points: open3d_ransac(points, **TUNED), "open3d"),
    "open3d ransac, defaults": Method(lambda points: open3d_ransac(points, **UNTUNED), "open3d"),
    "open3d patches": Method(open3d_patches, "open3d"),
}
