"""Each plane of a roof by itself: least squares, and what a change of the plane costs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lidar_buildings.core.model.array_types import BoolArray, FloatArray
from lidar_buildings.core.surfaces.roof_planes.moments import PlaneMoments, centroids_and_scatters

#: Steeper planes are walls: they stay as they are [deg].
STEEPEST_DEG = 80.0
#: Points whose second axis is shorter than this share of the first lie on a line: their plane is level.
_LINE = 1e-3
#: Weight of a plane's own slope beside its points' [m²]: keeps lines and single points solvable.
_PRIOR = 1e-4 * np.eye(3)


class FreePlanes(NamedTuple):
    """Planes z = a x + b y + c about the building's centre."""

    moments: PlaneMoments  #: the planes' points
    mean: FloatArray  #: centroids about the centre [m], shape (n_planes, 3)
    scatter: FloatArray  #: scatter matrices about the centroids [m²], shape (n_planes, 3, 3)
    normals: FloatArray  #: unit normals, pointing upwards, shape (n_planes, 3)
    rms: FloatArray  #: root mean square of the orthogonal distances [m], shape (n_planes,)
    coefficients: FloatArray  #: a, b, c, shape (n_planes, 3)
    #: Matrix Q: a plane changed by d has a sum of squared orthogonal distances greater by dᵀ Q d, shape
    #: (n_planes, 3, 3).
    cost: FloatArray
    roof: BoolArray  #: which are roofs: not a wall, and not without points, shape (n_planes,)

    @property
    def counts(self) -> FloatArray:
        """Number of points of each plane, at least 1."""
        return np.maximum(self.moments.sums[:, 0], 1.0)

    def offsets(self, coefficients: FloatArray) -> FloatArray:
        """Root mean square of the distances between each plane and another at its own points [m]."""
        change = coefficients - self.coefficients
        return np.sqrt(np.maximum(np.einsum("ki,kij,kj->k", change, self.cost, change), 0.0) / self.counts)


def free_planes(moments: PlaneMoments) -> FreePlanes:
    """Fit every plane to its points by orthogonal least squares."""
    sums = moments.sums
    mean, scatter = centroids_and_scatters(moments)
    values, axes = np.linalg.eigh(scatter)
    normals = axes[:, :, 0] * np.where(axes[:, 2:, 0] < 0, -1.0, 1.0)
    line = values[:, 1] <= _LINE**2 * values[:, 2]
    normals[line | (sums[:, 0] < 3)] = 0.0, 0.0, 1.0
    counts = np.maximum(sums[:, 0], 1.0)
    squares = np.einsum("ki,kij,kj->k", normals, scatter, normals)
    upright = np.maximum(normals[:, 2], 1e-6)
    slopes = -normals[:, :2] / upright[:, None]
    heights = mean[:, 2] - np.einsum("ki,ki->k", slopes, mean[:, :2])
    cost = sums[:, [4, 5, 1, 5, 7, 2, 1, 2, 0]].reshape(-1, 3, 3) * (upright**2)[:, None, None]
    cost = np.ascontiguousarray(cost + _PRIOR)
    roof = (sums[:, 0] > 0) & (normals[:, 2] > math.cos(math.radians(STEEPEST_DEG)))
    return FreePlanes(
        moments,
        mean,
        scatter,
        normals,
        np.sqrt(np.maximum(squares, 0.0) / counts),
        np.ascontiguousarray(np.column_stack([slopes, heights])),
        cost,
        roof,
    )
