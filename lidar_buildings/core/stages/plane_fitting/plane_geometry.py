"""
Least-squares planes inside compiled loops.

A plane is the array (a, b, c, d) of a x + b y + c z + d = 0 with a² + b² + c² = 1 and c ≥ 0.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

#: Number of sums that an orthogonal least-squares plane needs: n, Σx, Σy, Σz, Σxx, Σxy, Σxz, Σyy, Σyz, Σzz.
N_MOMENTS = 10
#: A normal whose cross product is smaller, relative to the scatter squared, is that of a line or a point.
_DEGENERATE = 1e-10


@njit(cache=True, nogil=True)
def add_point(moments: NDArray[np.float64], x: float, y: float, z: float) -> None:
    """Add one point to the sums."""
    moments[0] += 1.0
    moments[1] += x
    moments[2] += y
    moments[3] += z
    moments[4] += x * x
    moments[5] += x * y
    moments[6] += x * z
    moments[7] += y * y
    moments[8] += y * z
    moments[9] += z * z


@njit(cache=True, nogil=True)
def smallest_eigenvalue(xx: float, xy: float, xz: float, yy: float, yz: float, zz: float) -> float:
    """
    Return the smallest eigenvalue of a symmetric 3 × 3 matrix, by the roots of its characteristic cubic.
    """
    mean = (xx + yy + zz) / 3.0
    off = xy * xy + xz * xz + yz * yz
    spread = math.sqrt(((xx - mean) ** 2 + (yy - mean) ** 2 + (zz - mean) ** 2 + 2.0 * off) / 6.0)
    if spread == 0.0:
        return mean
    a, b, c = (xx - mean) / spread, (yy - mean) / spread, (zz - mean) / spread
    d, e, f = xy / spread, xz / spread, yz / spread
    half_determinant = 0.5 * (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e))
    angle = math.acos(min(1.0, max(-1.0, half_determinant))) / 3.0
    return mean + 2.0 * spread * math.cos(angle + 2.0 * math.pi / 3.0)


@njit(cache=True, nogil=True)
def normal_of(moments: NDArray[np.float64], plane: NDArray[np.float64]) -> bool:
    """
    Write the orthogonal least-squares plane of the summed points to `plane`; False if they lie on a line.
    """
    return fitted_plane(moments, plane) >= 0.0


@njit(cache=True, nogil=True)
def fitted_plane(moments: NDArray[np.float64], plane: NDArray[np.float64]) -> float:
    """
    Write the plane of `normal_of` to `plane`; return the sum of squared distances [m²], −1 if there is none.

    The normal is the eigenvector of the smallest eigenvalue λ of the covariance matrix: the longest cross
    product of two rows of (Σ − λI).
    """
    n = moments[0]
    if n < 3.0:
        return -1.0
    mx, my, mz = moments[1] / n, moments[2] / n, moments[3] / n
    xx, xy, xz = moments[4] / n - mx * mx, moments[5] / n - mx * my, moments[6] / n - mx * mz
    yy, yz, zz = moments[7] / n - my * my, moments[8] / n - my * mz, moments[9] / n - mz * mz
    smallest = smallest_eigenvalue(xx, xy, xz, yy, yz, zz)
    scatter = xx + yy + zz
    xx, yy, zz = xx - smallest, yy - smallest, zz - smallest
    ax, ay, az = xy * yz - xz * yy, xz * xy - xx * yz, xx * yy - xy * xy
    bx, by, bz = xy * zz - xz * yz, xz * xz - xx * zz, xx * yz - xy * xz
    cx, cy, cz = yy * zz - yz * yz, yz * xz - xy * zz, xy * yz - yy * xz
    a2, b2, c2 = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz, cx * cx + cy * cy + cz * cz
    if b2 > a2 and b2 >= c2:
        ax, ay, az, a2 = bx, by, bz, b2
    elif c2 > a2:
        ax, ay, az, a2 = cx, cy, cz, c2
    length = math.sqrt(a2)
    if length <= _DEGENERATE * scatter * scatter:
        return -1.0
    if az < 0.0:
        length = -length
    plane[0], plane[1], plane[2] = ax / length, ay / length, az / length
    plane[3] = -(plane[0] * mx + plane[1] * my + plane[2] * mz)
    return max(smallest, 0.0) * n


@njit(cache=True, nogil=True)
def plane_through(
    p: NDArray[np.float64], q: NDArray[np.float64], r: NDArray[np.float64], plane: NDArray[np.float64]
) -> bool:
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


@njit(cache=True, nogil=True)
def distance_of(plane: NDArray[np.float64], points: NDArray[np.float64], i: int) -> float:
    """Return the orthogonal distance of point i to a plane [m]."""
    return abs(plane[0] * points[i, 0] + plane[1] * points[i, 1] + plane[2] * points[i, 2] + plane[3])


@njit(cache=True, nogil=True)
def residual_of(moments: NDArray[np.float64]) -> float:
    """Return the sum of the squared distances of the summed points from their least-squares plane [m²]."""
    n = moments[0]
    if n < 3.0:
        return 0.0
    mx, my, mz = moments[1] / n, moments[2] / n, moments[3] / n
    least = smallest_eigenvalue(
        moments[4] / n - mx * mx,
        moments[5] / n - mx * my,
        moments[6] / n - mx * mz,
        moments[7] / n - my * my,
        moments[8] / n - my * mz,
        moments[9] / n - mz * mz,
    )
    return max(least, 0.0) * n
