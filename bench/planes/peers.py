"""
Ways to find the planes of roofs that are compared: this package's and those of libraries.

A peer is taken in if `pip` installs it from a wheel on Linux with Python 3.11 and its licence is permissive.

============  =========  ====================================================================================
package       licence    verdict
============  =========  ====================================================================================
open3d        MIT        taken: ``segment_plane`` (RANSAC), plane by plane, a method of the stage; and
                         ``detect_planar_patches`` (Araújo and Oliveira 2020)
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


def as_set(name: str) -> Method:
    """Return one of this package's other methods, which may need the package of that name."""

    def find(points: NDArray[np.float64]) -> NDArray[np.int64]:
        return own_method(PlaneFittingConfig(method=name)).find(points)

    return Method(find, name if name == "open3d" else "lidar_buildings")


#: Name → method, this package's first.
METHODS = {
    "lidar_buildings": own_method(PlaneFittingConfig()),
    "as published": own_method(AS_PUBLISHED),
    "fuzzy k-means": as_set("fuzzy_k_means"),
    "open3d": as_set("open3d"),
    "open3d patches": Method(open3d_patches, "open3d"),
}
