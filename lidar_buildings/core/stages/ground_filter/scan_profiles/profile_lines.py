"""Lines of least squares through the ground beside a point of a profile."""

from __future__ import annotations

import math

from lidar_buildings.core.kernels import kernel

#: Least mean square of the distances in which a slope can be seen [m²]; chosen with `bench.ground.isprs`.
MIN_SPREAD = 0.05
#: Number of points and sums of t, z, t², tz and z² before any is added.
NO_SUMS = (0, 0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def add_side(sums, along, z, ground, i, heading, begin, end, n_points, reach):  # type: ignore[no-untyped-def]
    """
    Add the nearest ground points on one side of point i to the sums, with t and z counted from point i.

    Parameters
    ----------
    sums : tuple of an int and five float
        See `NO_SUMS`.
    along, z : ndarray of shape (n,)
        Place along the profile and elevation [m].
    ground : ndarray of shape (n,), bool
        Which points count.
    i, heading : int
        The point, and the side: −1 or 1.
    begin, end : int
        Where its profile begins and ends.
    n_points : int
        Most points.
    reach : float
        How far they may be [m].
    """
    n, st, sz, stt, stz, szz = sums
    most, j = n + n_points, i + heading
    while begin <= j < end and n < most and abs(along[j] - along[i]) <= reach:
        if ground[j]:
            t, dz = along[j] - along[i], z[j] - z[i]
            n += 1
            st, sz, stt, stz, szz = st + t, sz + dz, stt + t * t, stz + t * dz, szz + dz * dz
        j += heading
    return n, st, sz, stt, stz, szz


@kernel
def spread_of(sums):  # type: ignore[no-untyped-def]
    """Return the sum of the squared distances along the profile from their mean [m²]."""
    n, st, _, stt, _, _ = sums
    return stt - st * st / n if n > 0 else 0.0


@kernel
def fitted_line(sums, max_slope):  # type: ignore[no-untyped-def]
    """
    Return the height of point i above the line [m], its slope, and the standard deviation of the points [m].

    The line is no steeper than `max_slope` where it is carried on to point i.
    """
    n, st, sz, _, stz, szz = sums
    slope = (stz - st * sz / n) / spread_of(sums)
    rest = max(szz - sz * sz / n - slope * (stz - st * sz / n), 0.0)
    slope = min(max(slope, -max_slope), max_slope)
    return -(sz - slope * st) / n, slope, math.sqrt(rest / (n - 2)) if n > 2 else 0.0
