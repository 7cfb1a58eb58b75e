"""Planes by Open3D's RANSAC, one after the other; Open3D is imported only here."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.stages.plane_fitting.config import PlaneFittingConfig

#: Planes through three random points that are tried for each plane; Open3D stops earlier where it may.
_N_SAMPLES = 1000
#: Points of one plane that are closer than this are connected; and as many round one make it a core of what
#: is connected (DBSCAN) [spacings].
_REACH, _CORE = 4.0, 5


def open3d_planes(
    points: FloatArray, spacing: float, min_points: int, config: PlaneFittingConfig
) -> NDArray[np.int32]:
    """
    Number the points of each plane, 0 = none, by `segment_plane` of Open3D (Zhou, Park and Koltun 2018).

    Of the plane with most points within the tolerance the largest cluster (`cluster_dbscan`) leaves the
    cloud, and so on until one has too few points. Open3D draws its samples in several threads: planes of two
    runs may differ.
    """
    try:
        import open3d
    except (ImportError, OSError) as error:  # a library of the system is missing
        raise ParameterError(
            f"plane_fitting.method = 'open3d': Open3D cannot be loaded ({error}): choose another method"
        ) from error
    open3d.utility.random.seed(config.random_state)
    order = np.lexsort(points.T[::-1])
    free, labels, number = order, np.zeros(len(points), dtype=np.int32), 0
    while len(free) >= max(min_points, 3):
        cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points[free]))
        plane, found = cloud.segment_plane(config.max_plane_distance, 3, _N_SAMPLES)
        rows = np.asarray(found, dtype=np.int64)
        part = np.asarray(
            cloud.select_by_index(found).cluster_dbscan(_REACH * spacing, _CORE), dtype=np.int64
        )
        rows = rows[part == np.bincount(part[part >= 0], minlength=1).argmax()]
        if len(rows) < min_points:
            break
        if abs(plane[2]) >= np.cos(np.radians(config.max_slope_deg)):
            number += 1
            labels[free[rows]] = number
        free = np.delete(free, rows)
    return labels
