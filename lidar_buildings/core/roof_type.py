"""
The kind of a roof, told from its planes.

"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.least_squares_plane import least_squares_plane

#: Planes less steep than this are flat [deg]: water runs off, the eye sees none of it.
_FLAT_DEG = 8.0
#: How far directions and slopes may differ from what the type asks for [deg].
_TOLERANCE_DEG = 20.0
#: Planes with a smaller share of all planes' points are details (dormers, chimneys).
_DETAIL_SHARE = 0.08
#: Without this share of the points in planes nothing can be said.
_MIN_EXPLAINED = 0.5
#: A roof without valleys lies under all its planes, but for so much [m], at so large a share of its points.
_ENVELOPE_DISTANCE, _ENVELOPE_SHARE = 0.3, 0.9
#: Directions of a hip roof's four planes from the first [deg].
_HIP_DIRECTIONS = np.array([0.0, 90.0, 180.0, 270.0])


def roof_type(points: NDArray[np.float64], plane_id: NDArray[np.uint16]) -> str:
    """
    Tell a building's kind of roof.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        Roof points [m].
    plane_id : ndarray of shape (n_points,)
        Number of each point's plane, 0 = none.

    Returns
    -------
    str
        ``flat`` (at one level or several), ``shed``, ``gable`` (two opposite planes), ``hip`` (four planes
        facing away from each other in pairs), ``complex`` for anything else and for any roof with valleys,
        ``unknown`` where too few points lie in planes.

    """
    numbers, counts = np.unique(plane_id[plane_id > 0], return_counts=True)
    n_planar = int(counts.sum())
    if n_planar == 0 or n_planar < _MIN_EXPLAINED * len(plane_id):
        return "unknown"
    large = numbers[counts >= _DETAIL_SHARE * n_planar]
    if not len(large):
        return "complex"
    planes = [least_squares_plane(points[plane_id == number]) for number in large]
    normals = np.array([normal for normal, _, _ in planes])
    centroids = np.array([centroid for _, centroid, _ in planes])
    slope = np.degrees(np.arccos(np.clip(normals[:, 2], -1.0, 1.0)))
    if np.all(slope < _FLAT_DEG):
        return "flat"
    if np.any(slope < _FLAT_DEG) or not _has_no_valley(points[np.isin(plane_id, large)], normals, centroids):
        return "complex"
    return _pitched_type(np.degrees(np.arctan2(normals[:, 1], normals[:, 0])), slope)


def _has_no_valley(
    points: NDArray[np.float64], normals: NDArray[np.float64], centroids: NDArray[np.float64]
) -> bool:
    """
    Whether nearly all points lie on or under every plane, so that planes meet in ridges and hips only.

    """
    above = (points @ normals.T - np.einsum("ij,ij->i", normals, centroids)).max(axis=1)
    return bool(np.mean(above <= _ENVELOPE_DISTANCE) >= _ENVELOPE_SHARE)


def _pitched_type(direction: NDArray[np.float64], slope: NDArray[np.float64]) -> str:
    """
    Tell the kind of a roof without flat parts from the directions [deg] its planes face, and their slopes.

    """
    relative = np.sort((direction - direction[0]) % 360.0)
    if len(relative) == 1:
        return "shed"
    if len(relative) == 2 and abs(relative[1] - 180.0) <= _TOLERANCE_DEG and np.ptp(slope) <= _TOLERANCE_DEG:
        return "gable"
    if len(relative) == 4 and np.all(np.abs(relative - _HIP_DIRECTIONS) <= _TOLERANCE_DEG):
        return "hip"
    return "complex"
