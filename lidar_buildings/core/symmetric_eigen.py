"""
Eigenvalues and the smallest eigenvector of symmetric 3×3 matrices in closed form.

"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

#: Parts of the largest element below which a number is rounding error.
TINY = 1e-14


@njit(cache=True, nogil=True)
def eigenvalues_3x3(xx, xy, xz, yy, yz, zz):  # type: ignore[no-untyped-def]
    """
    Return the eigenvalues λ1 ≥ λ2 ≥ λ3 of a positive semidefinite matrix; negative ones become 0.

    Trigonometric solution of the characteristic equation (Smith 1961), of the matrix divided by its largest
    element. Separate eigenvalues are exact to rounding, a double one to some 1e-8 of λ1.

    """
    scale = max(abs(xx), abs(xy), abs(xz), abs(yy), abs(yz), abs(zz))
    if scale == 0.0:
        return 0.0, 0.0, 0.0
    xx, xy, xz, yy, yz, zz = xx / scale, xy / scale, xz / scale, yy / scale, yz / scale, zz / scale
    mean = (xx + yy + zz) / 3.0
    a, b, c = xx - mean, yy - mean, zz - mean
    spread = math.sqrt((a * a + b * b + c * c + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0)
    if spread <= TINY:
        return mean * scale, mean * scale, mean * scale
    determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
    cosine = min(1.0, max(-1.0, determinant / (2.0 * spread**3)))
    angle = math.acos(cosine) / 3.0
    first = mean + 2.0 * spread * math.cos(angle)
    third = mean + 2.0 * spread * math.cos(angle + 2.0 * math.pi / 3.0)
    second = 3.0 * mean - first - third
    return max(first, 0.0) * scale, max(second, 0.0) * scale, max(third, 0.0) * scale


@njit(cache=True, nogil=True)
def smallest_eigenvector_3x3(xx, xy, xz, yy, yz, zz):  # type: ignore[no-untyped-def]
    """
    Return the unit eigenvector of λ3 with z ≥ 0; of several, the most upward one.

    The eigenvector of the better separated of λ1 and λ3 is the longest cross product of two rows of A − λI;
    if that is λ1, the plane across it holds the one wanted.

    """
    scale = max(abs(xx), abs(xy), abs(xz), abs(yy), abs(yz), abs(zz))
    if scale == 0.0:
        return _upward(0.0, 0.0, 1.0)
    m = (xx / scale, xy / scale, xz / scale, yy / scale, yz / scale, zz / scale)
    first, second, third = eigenvalues_3x3(*m)
    if first - third <= 1e-10 * first:
        return _upward(0.0, 0.0, 1.0)
    if second - third >= first - second:
        return _upward(*_kernel(m, third))
    return _smallest_across(m, _kernel(m, first))


@njit(cache=True, nogil=True)
def _kernel(m, eigenvalue):  # type: ignore[no-untyped-def]
    """
    Return the unit vector that A − λI turns to 0, λ being a single eigenvalue.

    """
    xx, xy, xz, yy, yz, zz = m
    xx, yy, zz = xx - eigenvalue, yy - eigenvalue, zz - eigenvalue
    ux, uy, uz = xy * yz - xz * yy, xz * xy - xx * yz, xx * yy - xy * xy
    vx, vy, vz = xy * zz - xz * yz, xz * xz - xx * zz, xx * yz - xy * xz
    wx, wy, wz = yy * zz - yz * yz, yz * xz - xy * zz, xy * yz - yy * xz
    u, v, w = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz
    if u < v:
        u, ux, uy, uz = v, vx, vy, vz
    if u < w:
        u, ux, uy, uz = w, wx, wy, wz
    length = math.sqrt(u)
    return ux / length, uy / length, uz / length


@njit(cache=True, nogil=True)
def _smallest_across(m, axis):  # type: ignore[no-untyped-def]
    """
    Return the eigenvector of λ3 among the directions across the eigenvector of λ1.

    """
    xx, xy, xz, yy, yz, zz = m
    ax, ay, az = axis
    across = math.sqrt(ax * ax + ay * ay)
    # u is the level direction across the axis, v the most upward one.
    ux, uy = (-ay / across, ax / across) if across > 1e-9 else (0.0, 1.0)
    vx, vy, vz = -az * uy, az * ux, ax * uy - ay * ux
    if across <= 1e-9:
        vx, vy, vz = 1.0, 0.0, 0.0
    uu = ux * ux * xx + 2.0 * ux * uy * xy + uy * uy * yy
    mx, my, mz = xx * vx + xy * vy + xz * vz, xy * vx + yy * vy + yz * vz, xz * vx + yz * vy + zz * vz
    uv = ux * mx + uy * my
    vv = vx * mx + vy * my + vz * mz
    if max(abs(uv), abs(uu - vv)) <= 1e-12:
        return _upward(vx, vy, vz)
    # The larger direction lies at this angle from u; the smaller one is across it.
    angle = 0.5 * math.atan2(2.0 * uv, uu - vv)
    s, c = math.sin(angle), math.cos(angle)
    return _upward(c * vx - s * ux, c * vy - s * uy, c * vz)


@njit(cache=True, nogil=True)
def _upward(x, y, z):  # type: ignore[no-untyped-def]
    """
    Return the vector or its opposite: z > 0, or else y > 0, or else x > 0.

    """
    if z < 0.0 or (z == 0.0 and (y < 0.0 or (y == 0.0 and x < 0.0))):
        x, y, z = -x, -y, -z
    # Rounding must not push a cosine beyond 1.
    return np.array((x, y, min(z, 1.0)))
