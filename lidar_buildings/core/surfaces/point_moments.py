"""Moments of points, added up one by one: what covariances and least-squares planes are made of."""

from __future__ import annotations

from lidar_buildings.core.kernels import kernel

#: Sums over points: n, Σx, Σy, Σz, Σxx, Σxy, Σxz, Σyy, Σyz, Σzz.
N_MOMENTS = 10


@kernel
def add_point(moments, x, y, z):  # type: ignore[no-untyped-def]
    """Add a point to its sums."""
    moments[0] += 1
    moments[1] += x
    moments[2] += y
    moments[3] += z
    moments[4] += x * x
    moments[5] += x * y
    moments[6] += x * z
    moments[7] += y * y
    moments[8] += y * z
    moments[9] += z * z


@kernel
def covariance(moments):  # type: ignore[no-untyped-def]
    """Return xx, xy, xz, yy, yz, zz of the covariance about the mean of at least one point."""
    n = moments[0]
    x, y, z = moments[1] / n, moments[2] / n, moments[3] / n
    return (
        moments[4] / n - x * x,
        moments[5] / n - x * y,
        moments[6] / n - x * z,
        moments[7] / n - y * y,
        moments[8] / n - y * z,
        moments[9] / n - z * z,
    )
