"""The filter as published: what lies between a large slope up and a large slope down is no ground."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.point_spacing import quantised_spacing
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.scan_profiles.profile_labelling import MIN_RUN, REENTRY_SLOPE
from lidar_buildings.core.stages.ground_filter.scan_profiles.profiles import cut_profiles
from lidar_buildings.core.stages.ground_filter.scan_profiles.scan_lines import find_scan_lines

#: Width of the strips from west to east that stand in for scan lines [spacings], as in `bidirectional_slope`.
WIDTH = 1.7


def label_ground(
    points: NDArray[np.float64],
    free: NDArray[np.bool_],
    config: GroundFilterConfig,
    **scan: NDArray[Any] | None,
) -> NDArray[np.bool_]:
    """
    Tell which free points are ground by the 1D bi-directional slope filter (Sampath & Shan 2007, page 806).

    Along each scan line the filter looks for slopes between consecutive points steeper than
    `profile_max_slope`. Points from a rise on, up to a fall back to the elevation recorded before the rise,
    are no ground. Each line is filtered forth and back; what either pass calls no ground is none.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In the scan's order [m].
    free : ndarray of shape (n_points,), bool
        Which of them are no gross errors.
    config : GroundFilterConfig
        `profile_max_slope`, `profile_step` (how near the recorded elevation a fall has to come) and
        `profile_max_object` (after which an elevation is recorded anew).
    **scan : ndarray of shape (n_points,), optional
        What tells scan lines apart, see `find_scan_lines`; strips from west to east where nothing does.
    """
    rows = np.flatnonzero(free)
    spacing = quantised_spacing(points[rows])
    lines = find_scan_lines(points, spacing, **scan)
    if lines is None:
        profiles = cut_profiles(points[rows], WIDTH * spacing, 0.0)
    else:
        profiles = lines.profiles(points, rows)
    limits = config.profile_max_slope, config.profile_step, config.profile_max_object
    own = rows[profiles.rows]
    ground = np.zeros(len(points), dtype=np.bool_)
    ground[own] = ~objects_between_slopes(profiles.along, points[own, 2], profiles.first, limits)
    return ground


@kernel
def objects_between_slopes(along, z, first, limits):  # type: ignore[no-untyped-def]
    """
    Return which points of profiles either pass finds between a rise and a fall.

    Limits are the slope, the distance from the recorded elevation [m], and the longest object [m].
    """
    is_object = np.zeros(len(z), dtype=np.bool_)
    for k in range(len(first) - 1):
        if first[k] < first[k + 1]:
            _walk(along, z, first[k], first[k + 1] - 1, 1, limits, is_object)
            _walk(along, z, first[k + 1] - 1, first[k], -1, limits, is_object)
    return is_object


@kernel
def _walk(along, z, start, end, heading, limits, is_object):  # type: ignore[no-untyped-def]
    """Mark what one pass finds; `ground` is the last ground point, whose elevation is recorded."""
    max_slope, tolerance, longest = limits
    ground, is_inside, i = start, False, start
    while i != end:
        before, i = i, i + heading
        slope = (z[i] - z[before]) / max(abs(along[i] - along[before]), MIN_RUN)
        run = abs(along[i] - along[ground])
        if is_inside:
            back = slope < -max_slope and z[i] <= z[ground] + tolerance + REENTRY_SLOPE * run
            is_inside = not back and run <= longest
        else:
            is_inside = slope > max_slope
        if is_inside:
            is_object[i] = True
        else:
            ground = i
