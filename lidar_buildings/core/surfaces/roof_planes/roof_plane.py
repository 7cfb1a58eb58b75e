"""A plane of a roof, and how planes are numbered."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import FloatArray

#: Normals are taken for no more level than this when elevations are asked for: a wall has none.
_LEAST_UPRIGHT = 1e-6


@dataclass(frozen=True, eq=False)
class RoofPlane:
    """One plane of a roof."""

    normal: FloatArray  #: unit normal, pointing upwards, shape (3,)
    #: Mean of the plane's points, map frame [m]; if the plane was adjusted, its own place above or below,
    #: shape (3,).
    centroid: FloatArray
    rms: float  #: root mean square of the points' orthogonal distances [m]
    n_points: int  #: number of points

    @property
    def gradient(self) -> FloatArray:
        """By how much the plane rises towards x and y [m/m]."""
        return np.array(self.equation[:2])

    @property
    def equation(self) -> tuple[float, float, float]:
        """a, b, c of z = a x + b y + c."""
        (nx, ny, nz), (x, y, z) = self.normal.tolist(), self.centroid.tolist()
        a, b = -nx / max(nz, _LEAST_UPRIGHT), -ny / max(nz, _LEAST_UPRIGHT)
        return a, b, z - a * x - b * y

    def elevation(self, xy: FloatArray) -> FloatArray:
        """Elevation of the plane [m] at positions of shape (n, 2)."""
        return np.asarray(self.centroid[2] + (xy - self.centroid[:2]) @ self.gradient)


def without_gaps(plane_id: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Number planes from 1 in their order; 0 stays."""
    counts = np.bincount(plane_id, minlength=1)
    counts[0] = 1
    number = np.flatnonzero(counts)
    if number[-1] == len(number) - 1:
        return plane_id
    new = np.zeros(len(counts), dtype=np.uint16)
    new[number] = np.arange(len(number))
    return new[plane_id]
