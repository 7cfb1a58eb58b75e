"""
Eigenvalues and axes of symmetric 3×3 matrices in closed form, without a branch or a trigonometric function.

Five times as fast as `numpy.linalg.eigh` (280,000 matrices: 0.13 s against 0.62 s), and callable in kernels.
The compiler turns a loop over matrices into vector instructions only if nothing in it branches or raises:
hence the selections instead of conditions, numpy's rules for division, and `forceinline`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from lidar_buildings.core.kernels import inner_kernel, kernel

#: Numbers below this are 0, lest a division by them overflows.
SMALLEST = 1e-200
#: Difference of the eigenvalues, in parts of their sum, from which on the better separated axis is known.
ISOTROPIC = 1e-10
#: Difference of two eigenvalues, in parts of the sum of all, below which they are one.
DOUBLE = 1e-12
SQRT_3 = math.sqrt(3.0)
#: Coefficients, the highest first, of the polynomial nearest to cos(arccos(x)/3) from 0 to 1: within 1e-8.
START = tuple(
    Chebyshev.interpolate(lambda x: np.cos(np.arccos(x) / 3.0), 7, (0.0, 1.0))
    .convert(kind=Polynomial)
    .coef[::-1]
    .tolist()
)


@kernel
def eigenvalues_3x3(xx, xy, xz, yy, yz, zz):  # type: ignore[no-untyped-def]
    """
    Return the eigenvalues λ1 ≥ λ2 ≥ λ3 of a positive semidefinite matrix; negative ones become 0.

    The characteristic equation in the form of Smith (1961): cos θ = det(A − m)/(2p³), λ = m + 2p cos(θ/3) and
    so on. cos(θ/3) is the root of 4y³ − 3y = |cos θ| between √3/2 and 1, where one step of Newton's method
    leads from the polynomial to rounding error. Separate eigenvalues are exact to rounding, a double one to
    some 1e-8 of λ1.
    """
    mean = (xx + yy + zz) / 3.0
    a, b, c = xx - mean, yy - mean, zz - mean
    p_square = (a * a + b * b + c * c + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0
    p = math.sqrt(p_square)
    determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
    cosine = min(abs(determinant) / max(2.0 * p * p_square, SMALLEST), 1.0)
    y = START[0]
    for k in range(1, len(START)):
        y = y * cosine + START[k]
    y -= ((4.0 * y * y - 3.0) * y - cosine) / (12.0 * y * y - 3.0)
    # The eigenvalue farthest from the others lies above or below them; they lie this far from their middle.
    signed, apart = math.copysign(p, determinant) * y, SQRT_3 * p * math.sqrt(max(1.0 - y * y, 0.0))
    first, third = max(2.0 * signed, apart - signed), min(2.0 * signed, -apart - signed)
    return mean + first, max(mean - first - third, 0.0), max(mean + third, 0.0)


@kernel
def values_and_normal(xx, xy, xz, yy, yz, zz):  # type: ignore[no-untyped-def]
    """
    Return λ1 ≥ λ2 ≥ λ3 and the axis of λ3 of a positive semidefinite matrix: six numbers.

    The axis of the eigenvalue farthest from the others is the longest cross product of two rows of A − λ;
    the two others lie across it, a matter of 2 × 2. So double eigenvalues are exact to rounding as well. The
    axis has z ≥ 0; where it is not unique it is the most upward one.
    """
    trace = xx + yy + zz
    scale = 1.0 / max(trace, SMALLEST)
    xx, xy, xz, yy, yz, zz = xx * scale, xy * scale, xz * scale, yy * scale, yz * scale, zz * scale
    first, second, third = eigenvalues_3x3(xx, xy, xz, yy, yz, zz)
    isotropic = first - third <= ISOTROPIC
    is_line = (first - second > second - third) & (not isotropic)
    ax, ay, az = _kernel(xx, xy, xz, yy, yz, zz, first if is_line else third)
    ax, ay, az = (0.0 if isotropic else ax), (0.0 if isotropic else ay), (1.0 if isotropic else az)
    # u is the level direction across the axis, v the most upward one.
    across = math.sqrt(ax * ax + ay * ay)
    upright = across <= 1e-9
    ux = 0.0 if upright else -ay / max(across, SMALLEST)
    uy = 1.0 if upright else ax / max(across, SMALLEST)
    vx, vy, vz = -az * uy, az * ux, ax * uy - ay * ux
    # A v and the 2 × 2 matrix in u and v.
    mx, my, mz = xx * vx + xy * vy + xz * vz, xy * vx + yy * vy + yz * vz, xz * vx + yz * vy + zz * vz
    uu, uv = ux * ux * xx + 2.0 * ux * uy * xy + uy * uy * yy, ux * mx + uy * my
    vv = vx * mx + vy * my + vz * mz
    middle, difference = 0.5 * (uu + vv), 0.5 * (uu - vv)
    apart = math.sqrt(difference * difference + uv * uv)
    c, s = _half_angle(difference, uv, apart)
    along = 1.0 - uu - vv
    nx, ny, nz = c * vx - s * ux, c * vy - s * uy, c * vz
    nx, ny, nz = _upward(nx if is_line else ax, ny if is_line else ay, nz if is_line else az)
    high, low = middle + apart, middle - apart
    first, third = max(along, high), min(along, low)
    second = max(min(along, high), low)
    return trace * first, trace * max(second, 0.0), trace * max(third, 0.0), nx, ny, nz


@kernel
def _kernel(xx, xy, xz, yy, yz, zz, eigenvalue):  # type: ignore[no-untyped-def]
    """Return the unit vector that A − λ turns to 0, λ being a single eigenvalue."""
    xx, yy, zz = xx - eigenvalue, yy - eigenvalue, zz - eigenvalue
    ux, uy, uz = xy * yz - xz * yy, xz * xy - xx * yz, xx * yy - xy * xy
    vx, vy, vz = xy * zz - xz * yz, xz * xz - xx * zz, xx * yz - xy * xz
    wx, wy, wz = yy * zz - yz * yz, yz * xz - xy * zz, xy * yz - yy * xz
    u, v, w = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz
    longer = u < v
    u = v if longer else u
    ux, uy, uz = (vx if longer else ux), (vy if longer else uy), (vz if longer else uz)
    longer = u < w
    u = w if longer else u
    ux, uy, uz = (wx if longer else ux), (wy if longer else uy), (wz if longer else uz)
    scale = 1.0 / math.sqrt(max(u, SMALLEST))
    return ux * scale, uy * scale, uz * scale


@inner_kernel
def _half_angle(cosine, sine, length):  # type: ignore[no-untyped-def]
    """Return cosine and sine of half the angle of a vector of this length; of none, 1 and 0."""
    single = length <= DOUBLE
    scale = 1.0 / max(length, SMALLEST)
    cosine, sine = (1.0 if single else cosine * scale), (0.0 if single else sine * scale)
    # The one of the two that is at least √½ is divided by.
    larger = math.sqrt(0.5 + 0.5 * abs(cosine))
    other = 0.5 * sine / larger
    return (larger if cosine >= 0.0 else other), (other if cosine >= 0.0 else larger)


@inner_kernel
def _upward(x, y, z):  # type: ignore[no-untyped-def]
    """Return the vector or its opposite: z > 0, or else y > 0, or else x > 0."""
    down = (z < 0.0) | ((z == 0.0) & ((y < 0.0) | ((y == 0.0) & (x < 0.0))))
    sign = -1.0 if down else 1.0
    # Rounding must not push a cosine beyond 1.
    return sign * x, sign * y, min(sign * z, 1.0)
