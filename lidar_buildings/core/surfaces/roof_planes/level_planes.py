"""Which planes of a roof are level, as far as their points can tell."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.model.array_types import IntArray
from lidar_buildings.core.surfaces.roof_planes.free_planes import FreePlanes

#: Levelling may move a plane by this share of its own roughness at its points,
_SHARE_OF_RMS = 0.5
#: but by no less and no more than this [m].
_LEAST_MOVE, _MOST_MOVE = 0.02, 0.04
#: Largest slope that may become level [m/m].
_MOST_SLOPE = 0.06


def level_planes(planes: FreePlanes) -> IntArray:
    """
    Return the number of the level surface that each roof plane is a piece of; -1 for planes that are not.

    Planes become level that do not move more at their points than these are rough, and one surface with the
    largest of those that are as near in height.
    """
    gradients = planes.coefficients[:, :2]
    scatter = planes.scatter[:, :2, :2] / planes.counts[:, None, None]
    squares = np.einsum("ki,kij,kj->k", gradients, scatter, gradients) * planes.normals[:, 2] ** 2
    allowed = np.clip(_SHARE_OF_RMS * planes.rms, _LEAST_MOVE, _MOST_MOVE)
    is_gentle = np.hypot(gradients[:, 0], gradients[:, 1]) <= _MOST_SLOPE
    left = planes.roof & is_gentle & (np.sqrt(np.maximum(squares, 0.0)) <= allowed)
    surface = np.full(len(left), -1, dtype=np.int64)
    for k in np.argsort(-planes.counts, kind="stable"):
        if left[k]:
            near = np.abs(planes.mean[:, 2] - planes.mean[k, 2]) <= np.minimum(allowed, allowed[k])
            surface[left & near] = surface.max() + 1
            left &= ~near
    return surface
