"""
Least squares of all planes of a roof.

"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.outline import Outline
from lidar_buildings.core.roof_planes.moments import centroids_and_scatters, plane_moments
from lidar_buildings.core.roof_planes.roof_plane import RoofPlane


def adjust_planes(
    points: NDArray[np.float64],
    plane_id: NDArray[np.uint16],
    *,
    outline: Outline | None = None,
    point_spacing: float | None = None,
) -> tuple[RoofPlane, ...]:
    """
    Fit the planes of a roof by orthogonal least squares.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In any order [m].
    plane_id : ndarray of shape (n_points,)
        Number of each point's plane, 0 = none.
    outline : Outline, optional
        Its main directions are those that planes may face.
    point_spacing : float, optional
        [m].

    Returns
    -------
    tuple of RoofPlane
        Plane number k is item k - 1; a number without points has a level plane at the centre.

    """
    n_planes = int(plane_id.max()) if len(plane_id) else 0
    moments = plane_moments(points, plane_id, n_planes)
    mean, scatter = centroids_and_scatters(moments)
    values, axes = np.linalg.eigh(scatter)
    normals = axes[:, :, 0] * np.where(axes[:, 2:, 0] < 0, -1.0, 1.0)
    counts = moments.sums[:, 0]
    rms = np.sqrt(np.maximum(values[:, 0], 0.0) / np.maximum(counts, 1.0))
    centroids = mean + moments.centre
    return tuple(RoofPlane(normals[k], centroids[k], float(rms[k]), int(counts[k])) for k in range(n_planes))
