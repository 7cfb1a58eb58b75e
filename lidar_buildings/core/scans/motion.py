"""Points placed by the pose at the time of each: poses are looked up every few milliseconds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.scans.trajectory import Poses

#: Longest time between two poses that are looked up [ns]. What lies between is a line and the straight way
#: between quaternions: at 100° a second off by 10 nrad, and of a lever arm of 1 m by 10 µm.
_STEP = 5_000_000


def place_points(
    look_up: Callable[[NDArray[np.int64]], Poses],
    stamps: NDArray[np.int64],
    times: NDArray[np.int64],
    points: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """
    Place points (n, 3) in the moving frame [m], one at least, by the poses at their times (n,) [ns].

    Between `stamps` [ns] poses move steadily, and are known or not as a whole; `look_up` returns those at
    some times. Return the points, anything where no pose is known, and whether one is.
    """
    moments = _moments(stamps, times)
    at, between = look_up(moments), look_up(moments + np.diff(moments, append=moments[-1]) // 2)
    found, is_known = np.empty_like(points), np.empty(len(points), dtype=np.bool_)
    attitudes = at.rotation.as_quat()
    _place(moments, at.translation, attitudes, at.is_known, between.is_known, times, points, found, is_known)
    return found, is_known


def _moments(stamps: NDArray[np.int64], times: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return when poses are looked up: every `_STEP`, and where they change; or at each point's own time."""
    first, last = int(times.min()), int(times.max())
    inside = stamps[(stamps > first) & (stamps < last)]
    if (last - first) // _STEP + len(inside) + 2 >= len(times):
        return np.unique(times)
    return np.unique(np.concatenate([np.arange(first, last, _STEP), inside, [last]]))


@kernel
def _place(moments, places, attitudes, is_known_at, is_known_after, times, points, found, is_known):  # type: ignore[no-untyped-def]
    """Write to `found` where points are, and to `is_known` whether that is known."""
    k, last = 0, len(moments) - 1
    for i in range(len(times)):
        time = times[i]
        if not moments[k] <= time < moments[min(k + 1, last)]:
            k = min(k + 1, last)
            if not moments[k] <= time < moments[min(k + 1, last)]:
                k = np.searchsorted(moments, time, side="right") - 1
        n = min(k + 1, last)
        share = 0.0
        is_known[i] = is_known_at[k]
        if time > moments[k]:
            share = (time - moments[k]) / (moments[n] - moments[k])
            is_known[i] = is_known_after[k]
        a, b = attitudes[k], attitudes[n]
        rest = 1.0 - share
        if a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] < 0.0:  # the shorter way
            rest = -rest
        qx, qy = rest * a[0] + share * b[0], rest * a[1] + share * b[1]
        qz, qw = rest * a[2] + share * b[2], rest * a[3] + share * b[3]
        rest = abs(rest)
        scale = 2.0 / (qx * qx + qy * qy + qz * qz + qw * qw)
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        # v + 2 w (q × v) + 2 q × (q × v), over the square of the quaternion's length
        tx, ty, tz = scale * (qy * z - qz * y), scale * (qz * x - qx * z), scale * (qx * y - qy * x)
        found[i, 0] = x + qw * tx + qy * tz - qz * ty + rest * places[k, 0] + share * places[n, 0]
        found[i, 1] = y + qw * ty + qz * tx - qx * tz + rest * places[k, 1] + share * places[n, 1]
        found[i, 2] = z + qw * tz + qx * ty - qy * tx + rest * places[k, 2] + share * places[n, 2]
