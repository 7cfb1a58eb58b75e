"""One plane of a roof."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidar_buildings.core.model.array_types import FloatArray

#: Normals are taken for no more level than this when elevations are asked for: a wall has none.
_LEAST_UPRIGHT = 1e-6


@dataclass(frozen=True, eq=False)
class RoofPlane:
    """
    One plane of a roof.

    Attributes
    ----------
    normal : ndarray of shape (3,)
        Unit normal, pointing upwards.
    centroid : ndarray of shape (3,)
        Mean of the plane's points, map frame [m]; if the plane was adjusted, its own place above or below.
    rms : float
        Root mean square of the points' orthogonal distances [m].
    n_points : int
        Number of points.
    """

    normal: FloatArray
    centroid: FloatArray
    rms: float
    n_points: int

    @property
    def gradient(self) -> FloatArray:
        """By how much the plane rises towards x and y [m/m]."""
        return -self.normal[:2] / max(float(self.normal[2]), _LEAST_UPRIGHT)

    def elevation(self, xy: FloatArray) -> FloatArray:
        """Elevation of the plane [m] at positions of shape (n, 2)."""
        return np.asarray(self.centroid[2] + (xy - self.centroid[:2]) @ self.gradient)
