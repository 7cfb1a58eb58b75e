"""Which planes of a roof are level, as far as their points can tell."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import IntArray
from lidar_buildings.core.surfaces.roof_planes.free_planes import FreePlanes

#: Levelling may move a plane by this share of its own roughness at its points,
_SHARE_OF_RMS = 0.5
#: but by no less and no more than this [m].
_LEAST_MOVE, _MOST_MOVE = 0.02, 0.04


def level_planes(planes: FreePlanes) -> IntArray:
    """
    Return the number of the level surface that each roof plane is a piece of; -1 for planes that are not.

    Planes become level that do not move more at their points than these are rough, and one surface with the
    largest of those that are as near in height.
    """
    return _level(
        planes.mean,
        planes.scatter,
        planes.counts,
        planes.normals,
        planes.rms,
        planes.coefficients,
        planes.roof,
    )


@kernel
def _level(mean, scatter, counts, normals, rms, coefficients, roof):  # type: ignore[no-untyped-def]
    """See `level_planes`."""
    n = len(counts)
    left, allowed, surface = np.empty(n, np.bool_), np.empty(n), np.full(n, -1)
    for k in range(n):
        a, b = coefficients[k, 0], coefficients[k, 1]
        square = a * a * scatter[k, 0, 0] + 2.0 * a * b * scatter[k, 0, 1] + b * b * scatter[k, 1, 1]
        moved = math.sqrt(max(square / counts[k], 0.0)) * normals[k, 2]
        allowed[k] = min(max(_SHARE_OF_RMS * rms[k], _LEAST_MOVE), _MOST_MOVE)
        left[k] = roof[k] and moved <= allowed[k]
    n_surfaces = 0
    while True:
        largest = -1
        for k in range(n):
            if left[k] and (largest < 0 or counts[k] > counts[largest]):
                largest = k
        if largest < 0:
            return surface
        for k in range(n):
            off = abs(mean[k, 2] - mean[largest, 2])
            if left[k] and off <= min(allowed[k], allowed[largest]):
                surface[k], left[k] = n_surfaces, False
        n_surfaces += 1
