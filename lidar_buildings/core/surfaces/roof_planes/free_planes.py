"""Each plane of a roof by itself: least squares, and what a change of the plane costs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray
from lidar_buildings.core.surfaces.roof_planes.moments import PlaneMoments, centroids_and_scatters

#: Steeper planes are walls: they stay as they are [deg].
STEEPEST_DEG = 80.0
#: Points whose second axis is shorter than this share of the first lie on a line: their plane is level.
_LINE = 1e-3
#: Weight of a plane's own slope beside its points' [m²]: keeps lines and single points solvable.
_PRIOR = 1e-4
_LEAST_UPRIGHT = math.cos(math.radians(STEEPEST_DEG))


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
    mean, scatter = centroids_and_scatters(moments.sums)
    values, axes = np.linalg.eigh(scatter)
    return FreePlanes(moments, mean, scatter, *_planes(moments.sums, mean, scatter, values, axes))


@kernel
def _planes(sums, mean, scatter, values, axes):  # type: ignore[no-untyped-def]
    """Return normals, roughness, coefficients, costs and which are roofs; see `FreePlanes`."""
    n_planes = len(sums)
    normals, rms, roof = np.zeros((n_planes, 3)), np.empty(n_planes), np.empty(n_planes, np.bool_)
    coefficients, cost = np.empty((n_planes, 3)), np.empty((n_planes, 3, 3))
    # Of the sums, those of products of x, y and 1.
    products = np.array([[4, 5, 1], [5, 7, 2], [1, 2, 0]])
    for k in range(n_planes):
        normal, count = normals[k], max(sums[k, 0], 1.0)
        if values[k, 1] <= _LINE**2 * values[k, 2] or sums[k, 0] < 3:
            normal[2] = 1.0
        else:
            for i in range(3):
                normal[i] = -axes[k, i, 0] if axes[k, 2, 0] < 0.0 else axes[k, i, 0]
        square = 0.0
        for i in range(3):
            for j in range(3):
                square += normal[i] * scatter[k, i, j] * normal[j]
        rms[k] = math.sqrt(max(square, 0.0) / count)
        upright = max(normal[2], 1e-6)
        a, b = -normal[0] / upright, -normal[1] / upright
        coefficients[k, 0], coefficients[k, 1] = a, b
        coefficients[k, 2] = mean[k, 2] - (a * mean[k, 0] + b * mean[k, 1])
        for i in range(3):
            for j in range(3):
                cost[k, i, j] = sums[k, products[i, j]] * upright**2 + (_PRIOR if i == j else 0.0)
        roof[k] = sums[k, 0] > 0.0 and normal[2] > _LEAST_UPRIGHT
    return normals, rms, coefficients, cost, roof
