"""Running sums of a ring's points, from which the best line and circle of any stretch follow at once."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import kernel

#: Columns: Σw, Σwx, Σwy, Σwxx, Σwxy, Σwyy, Σwxz, Σwyz, Σwzz with z = x² + y².
N_SUMS = 9
#: A determinant smaller than this share of the squared trace belongs to points on a line.
_FLAT = 1e-9


@kernel
def running_sums(points, weights):  # type: ignore[no-untyped-def]
    """
    Return the sums over the points before each, going round twice, so that stretches may pass the start.

    Row i of (2 n_points + 2, 9) is of the points before the i-th, which are about the building's centre.
    """
    n = len(points)
    sums = np.zeros((2 * n + 2, N_SUMS))
    for i in range(2 * n + 1):
        k = i % n
        x, y, w = points[k, 0], points[k, 1], weights[k]
        z = x * x + y * y
        sums[i + 1, 0] = sums[i, 0] + w
        sums[i + 1, 1] = sums[i, 1] + w * x
        sums[i + 1, 2] = sums[i, 2] + w * y
        sums[i + 1, 3] = sums[i, 3] + w * x * x
        sums[i + 1, 4] = sums[i, 4] + w * x * y
        sums[i + 1, 5] = sums[i, 5] + w * y * y
        sums[i + 1, 6] = sums[i, 6] + w * x * z
        sums[i + 1, 7] = sums[i, 7] + w * y * z
        sums[i + 1, 8] = sums[i, 8] + w * z * z
    return sums


@kernel
def scatter_of(sums, start, end):  # type: ignore[no-untyped-def]
    """Return the weight of a stretch, its middle and its scatter: sums of xx, xy, yy about the middle."""
    weight = sums[end, 0] - sums[start, 0]
    x, y = (sums[end, 1] - sums[start, 1]) / weight, (sums[end, 2] - sums[start, 2]) / weight
    xx = sums[end, 3] - sums[start, 3] - x * x * weight
    xy = sums[end, 4] - sums[start, 4] - x * y * weight
    yy = sums[end, 5] - sums[start, 5] - y * y * weight
    return weight, x, y, max(xx, 0.0), xy, max(yy, 0.0)


@kernel
def least_scatter(xx, xy, yy):  # type: ignore[no-untyped-def]
    """Return the scatter across the best line: the smaller eigenvalue."""
    return max(0.5 * (xx + yy) - math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy), 0.0)


@kernel
def normal_angle(xx, xy, yy):  # type: ignore[no-untyped-def]
    """Return the direction of the least scatter, −π/2 to π/2 and beyond by π/2 [rad]."""
    return 0.5 * np.arctan2(2.0 * xy, xx - yy) + 0.5 * np.pi


@kernel
def algebraic_circle(sums, start, end):  # type: ignore[no-untyped-def]
    """
    Return centre, radius and squared offsets of the circle with the least Σ (d² − r²)² (Kåsa, 1976).

    The offsets are those of the points from the circle to first order, (d² − r²) / 2r; radius and offsets are
    infinite where the points lie on a line.
    """
    weight, mx, my, uu, uv, vv = scatter_of(sums, start, end)
    determinant = uu * vv - uv * uv
    if determinant <= _FLAT * (uu + vv) ** 2:
        return mx, my, np.inf, np.inf
    zz_mean = uu + vv
    square = mx * mx + my * my
    z = sums[end, 3] - sums[start, 3] + sums[end, 5] - sums[start, 5]
    uz = sums[end, 6] - sums[start, 6] - mx * z - 2.0 * (mx * uu + my * uv)
    vz = sums[end, 7] - sums[start, 7] - my * z - 2.0 * (mx * uv + my * vv)
    zz = (
        sums[end, 8]
        - sums[start, 8]
        - 4.0 * (mx * mx * uu + my * my * vv + 2.0 * mx * my * uv)
        - weight * square * square
        - 4.0 * (mx * uz + my * vz)
        - 2.0 * square * zz_mean
    )
    a = 0.5 * (vv * uz - uv * vz) / determinant
    b = 0.5 * (uu * vz - uv * uz) / determinant
    squared_radius = a * a + b * b + zz_mean / weight
    residual = zz - zz_mean * zz_mean / weight - 2.0 * (a * uz + b * vz)
    return mx + a, my + b, np.sqrt(squared_radius), max(residual, 0.0) / (4.0 * squared_radius)
