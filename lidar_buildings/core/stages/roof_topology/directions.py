"""The directions that a building's outline and planes have in common."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray

#: Cosine of four times the angle by which directions that are one may differ: 5 degrees.
_TOLERANCE = math.cos(math.radians(20.0))
#: A direction needs this share of the sum of all weights.
_LEAST_SHARE = 0.08
#: Most directions, each standing for itself and its perpendicular.
_MOST = 6


@kernel
def main_directions(angles, weights):  # type: ignore[no-untyped-def]
    """
    Group weighted directions that are parallel or perpendicular; return the mean of each group, 0 to π/2.

    The weightiest comes first.
    """
    x, y, left = np.empty(len(angles)), np.empty(len(angles)), np.empty(len(angles), np.bool_)
    total = 0.0
    for i in range(len(angles)):
        x[i], y[i], left[i] = math.cos(4.0 * angles[i]), math.sin(4.0 * angles[i]), weights[i] > 0.0
        total += weights[i]
    groups = np.empty(_MOST)
    for n in range(_MOST):
        best, most = -1, 0.0
        for i in range(len(x)):
            near = 0.0
            for j in range(len(x)):
                if left[i] and left[j] and x[i] * x[j] + y[i] * y[j] >= _TOLERANCE:
                    near += weights[j]
            if near > most:
                best, most = i, near
        if best < 0 or most < _LEAST_SHARE * total:
            return groups[:n]
        u, v, east, north = x[best], y[best], 0.0, 0.0
        for j in range(len(x)):
            if left[j] and u * x[j] + v * y[j] >= _TOLERANCE:
                east, north, left[j] = east + weights[j] * x[j], north + weights[j] * y[j], False
        groups[n] = math.atan2(north, east) / 4.0 % (math.pi / 2.0)
    return groups


def wall_directions(walls: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return angle [rad] and length [m] of edges given by their ends."""
    edges = walls[:, 1] - walls[:, 0]
    return np.arctan2(edges[:, 1], edges[:, 0]), np.hypot(edges[:, 0], edges[:, 1])


def plane_directions(gradients: FloatArray, area: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the azimuth of every plane [rad] and what it counts as an edge of an outline would [m]."""
    steepness = np.hypot(gradients[:, 0], gradients[:, 1])
    weight = np.sqrt(area) * np.minimum(steepness / 0.2, 1.0)
    return np.arctan2(gradients[:, 1], gradients[:, 0]), weight
