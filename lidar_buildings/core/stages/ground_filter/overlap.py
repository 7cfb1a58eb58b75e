"""Points of overlapping strips that stand in where nothing else was recorded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.neighbours.point_spacing import given_or_measured

#: A place is covered if a point lies within so many spacings; by chance 1 in 10⁵ places has none.
_REACH = 2.0


def used_classes(
    points: NDArray[np.float64], classification: NDArray[np.uint8] | None, point_spacing: float | None = None
) -> NDArray[np.uint8] | None:
    """
    Return the source's classes, 0 for points of class 12 where no other point but noise covers the place.

    So they are classified as any other point; those beside them are, too, up to where others begin.
    """
    if classification is None or PointClass.OVERLAP not in classification:
        return classification
    used = classification == PointClass.OVERLAP
    reach = _REACH * given_or_measured(points, point_spacing)
    covers = ~used & ~np.isin(classification, (PointClass.LOW_NOISE, PointClass.HIGH_NOISE))
    overlap = points[used, :2]
    lone = overlap[~_has_near(overlap, points[covers, :2], reach)]
    used[used] = _has_near(overlap, lone, reach)
    return np.where(used, np.uint8(PointClass.NEVER_CLASSIFIED), classification)


def _has_near(places: NDArray[np.float64], others: NDArray[np.float64], reach: float) -> NDArray[np.bool_]:
    if not len(others):
        return np.zeros(len(places), dtype=bool)
    distance = cKDTree(others).query(places, distance_upper_bound=reach)[0]
    near: NDArray[np.bool_] = np.isfinite(distance)
    return near
