"""The directions that a building's outline and planes have in common."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.model.array_types import FloatArray

#: Directions that differ by less are one [deg].
_TOLERANCE_DEG = 5.0
#: A direction needs this share of the sum of all weights.
_LEAST_SHARE = 0.08
#: Most directions, each standing for itself and its perpendicular.
_MOST = 6


def main_directions(angles: FloatArray, weights: FloatArray) -> FloatArray:
    """
    Group directions that are parallel or perpendicular, and return the mean of each group.

    Parameters
    ----------
    angles : ndarray of shape (n,)
        Directions [rad].
    weights : ndarray of shape (n,)
        What each counts.

    Returns
    -------
    ndarray of shape (n_groups,)
        Angles from 0 to π/2 [rad], the weightiest first.
    """
    remaining = np.exp(4j * angles) * weights
    total = weights.sum()
    groups: list[float] = []
    tolerance = math.cos(math.radians(4 * _TOLERANCE_DEG))
    weight = weights.copy()
    while len(groups) < _MOST and len(remaining):
        axis = remaining / np.maximum(weight, 1e-300)
        near = (axis[:, None] * axis.conj()[None, :]).real >= tolerance
        best = int(np.argmax(near @ weight))
        members = near[best]
        if weight[members].sum() < _LEAST_SHARE * total or total <= 0:
            break
        groups.append(float(np.angle(remaining[members].sum()) / 4 % (math.pi / 2)))
        remaining, weight = remaining[~members], weight[~members]
    return np.array(groups)


def outline_directions(rings: tuple[FloatArray, ...]) -> tuple[FloatArray, FloatArray]:
    """Return angle [rad] and length [m] of every edge of an outline."""
    if not rings:
        return np.zeros(0), np.zeros(0)
    edges = np.concatenate([np.roll(ring, -1, axis=0) - ring for ring in rings])
    return np.arctan2(edges[:, 1], edges[:, 0]), np.hypot(edges[:, 0], edges[:, 1])


def plane_directions(gradients: FloatArray, area: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the azimuth of every plane [rad] and what it counts as an edge of an outline would [m]."""
    steepness = np.hypot(gradients[:, 0], gradients[:, 1])
    weight = np.sqrt(area) * np.minimum(steepness / 0.2, 1.0)
    return np.arctan2(gradients[:, 1], gradients[:, 0]), weight
