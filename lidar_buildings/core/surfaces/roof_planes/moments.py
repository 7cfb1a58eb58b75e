"""Sums over the points of each plane, the same whatever the order of the points."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.surfaces.point_moments import N_MOMENTS, add_point

#: Bits of an integer that a sum of products may take.
_SUM_BITS = 62
#: Coordinates are rounded to 2^-13 m, an eighth of a millimetre, unless the building is enormous.
_FINEST_BITS = 13


class PlaneMoments(NamedTuple):
    """Sums of coordinates and their products about the building's centre, plane by plane."""

    centre: FloatArray  #: middle of the points' bounding box [m], shape (3,)
    sums: FloatArray  #: n, Σx, Σy, Σz, Σxx, Σxy, Σxz, Σyy, Σyz, Σzz about the centre, shape (n_planes, 10)


def plane_moments(points: FloatArray, plane_id: NDArray[np.uint16], n_planes: int) -> PlaneMoments:
    """
    Sum the coordinates of each plane's points, and their products; plane 0 is none.

    Coordinates are counted in whole fractions of a metre: sums of integers do not depend on their order.
    """
    if not len(points):
        return PlaneMoments(np.zeros(3), np.zeros((n_planes, N_MOMENTS)))
    low, high = extent_of(points)
    centre = 0.5 * (low + high)
    half = max(float((high - low).max()), 1e-3)
    bits = min(_FINEST_BITS, int((_SUM_BITS - math.log2(len(points))) / 2 - math.log2(half)))
    sums = np.zeros((n_planes, N_MOMENTS), dtype=np.int64)
    unit = 2.0**bits
    _add_points(points, plane_id, centre, unit, sums)
    scale = np.array([1.0, *[1 / unit] * 3, *[1 / unit**2] * 6])
    return PlaneMoments(centre, sums * scale)


@kernel
def _add_points(points, plane_id, centre, unit, sums):  # type: ignore[no-untyped-def]
    for i in range(len(points)):
        k = np.int64(plane_id[i]) - 1
        if k < 0:
            continue
        x = np.int64(np.rint((points[i, 0] - centre[0]) * unit))
        y = np.int64(np.rint((points[i, 1] - centre[1]) * unit))
        z = np.int64(np.rint((points[i, 2] - centre[2]) * unit))
        add_point(sums[k], x, y, z)


@kernel
def centroids_and_scatters(sums):  # type: ignore[no-untyped-def]
    """
    Return each plane's centroid about the centre, shape (n, 3), and its scatter matrix about it, (n, 3, 3).
    """
    mean, scatter = np.empty((len(sums), 3)), np.empty((len(sums), 3, 3))
    # Of the sums, those of products of x, y and z.
    products = np.array([[4, 5, 6], [5, 7, 8], [6, 8, 9]])
    for k in range(len(sums)):
        n = max(sums[k, 0], 1.0)
        for i in range(3):
            mean[k, i] = sums[k, 1 + i] / n
        for i in range(3):
            for j in range(3):
                scatter[k, i, j] = sums[k, products[i, j]] - n * mean[k, i] * mean[k, j]
    return mean, scatter
