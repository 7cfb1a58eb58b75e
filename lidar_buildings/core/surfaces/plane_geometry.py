"""
Least-squares planes inside compiled loops.

A plane is the array (a, b, c, d) of a x + b y + c z + d = 0 with a² + b² + c² = 1 and c ≥ 0.
"""

from __future__ import annotations

import math

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.surfaces.point_moments import covariance
from lidar_buildings.core.surfaces.symmetric_eigen import eigenvalues_3x3, values_and_normal

#: A normal is that of a line or a point if (λ1 − λ3)(λ2 − λ3) is a smaller share of the squared scatter: wide
#: margin, rounding leaves 1e-15.
_DEGENERATE = 1e-10


@kernel
def fitted_plane(moments: FloatArray, plane: FloatArray) -> float:
    """
    Write the orthogonal least-squares plane of the summed points to `plane`.

    Return the sum of squared distances [m²]; −1, and nothing written, if the points lie on a line.
    """
    n = moments[0]
    if n < 3.0:
        return -1.0
    first, second, third, a, b, c = values_and_normal(*covariance(moments))
    if (first - third) * (second - third) <= _DEGENERATE * (first + second + third) ** 2:
        return -1.0
    plane[0], plane[1], plane[2] = a, b, c
    plane[3] = -(a * (moments[1] / n) + b * (moments[2] / n) + c * (moments[3] / n))
    return third * n


@inner_kernel
def residual_of(moments: FloatArray) -> float:
    """Return the sum of the squared distances of the summed points from their least-squares plane [m²]."""
    n = moments[0]
    return eigenvalues_3x3(*covariance(moments))[2] * n if n >= 3.0 else 0.0


@kernel
def plane_through(p: FloatArray, q: FloatArray, r: FloatArray, plane: FloatArray) -> bool:
    """Write the plane through three points to `plane`; False if they lie on a line."""
    ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    vx, vy, vz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if length <= 1e-6 * (ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz):
        return False
    if nz < 0.0:
        length = -length
    plane[0], plane[1], plane[2] = nx / length, ny / length, nz / length
    plane[3] = -(plane[0] * p[0] + plane[1] * p[1] + plane[2] * p[2])
    return True


@inner_kernel
def distance_of(plane: FloatArray, points: FloatArray, i: int) -> float:
    """Return the orthogonal distance of point i to a plane [m]."""
    return abs(plane[0] * points[i, 0] + plane[1] * points[i, 1] + plane[2] * points[i, 2] + plane[3])
