"""
Ground by slopes along profiles, forth and back (Shan & Sampath 2005), with profiles across where wanted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.scan_profiles.profile_labelling import net_votes
from lidar_buildings.core.stages.ground_filter.scan_profiles.profile_refinement import reject_outliers
from lidar_buildings.core.stages.ground_filter.scan_profiles.profile_regression import grow_ground
from lidar_buildings.core.stages.ground_filter.scan_profiles.profile_trend import fit_trend
from lidar_buildings.core.stages.ground_filter.scan_profiles.profiles import Profiles, cut_profiles

# Chosen with `bench.ground.isprs`.
#: Width of the strips that are cut as profiles [multiples of the spacing].
WIDTH = 1.7
#: By how much more passes have to call a point ground than object, as a share of all.
AGREEMENT = 0.1
#: Distance over which the terrain is smoothed before its slope is taken off [m]; passes err less on what is
#: left: so much less agreement is asked of them.
TREND_RADIUS, LESS_ON_TREND = 20.0, 0.1
#: Where the trend of all points is steeper than this share of `profile_max_slope`, the first passes look at
#: heights above it: uphill every one leaves the ground otherwise.
STEEP_SHARE = 0.5


def label_candidates(
    candidates: NDArray[np.float64],
    spacing: float,
    config: GroundFilterConfig,
    scanned: Sequence[Profiles] = (),
) -> NDArray[np.bool_]:
    """
    Tell which candidates are ground by walking along profiles in both directions.

    Where a profile rises by a step it leaves the ground, and is back on it where it has come down to the
    elevation it left (Shan & Sampath 2005). Profiles are the scan lines, where the cloud has any, and strips
    cut in `profile_directions` directions; passes in all directions vote. Ground is then grown along the
    profiles by local regression, the slope of the terrain taken off, and all repeated.

    Parameters
    ----------
    candidates : ndarray of shape (n_candidates, 3)
        At least one; at most one per cell, without gross errors [m].
    spacing : float
        Of the candidates [m].
    config : GroundFilterConfig
        The members that begin with `profile_`.
    scanned : sequence of Profiles, optional
        The scan lines, see `find_scan_lines`.

    Returns
    -------
    ndarray of shape (n_candidates,), bool
    """
    n = config.profile_directions
    profiles = [cut_profiles(candidates, WIDTH * spacing, 180.0 * k / n) for k in range(n)]
    profiles += scanned
    z = candidates[:, 2]
    net = net_votes(profiles, z, config)
    trend = fit_trend(candidates, np.ones(len(z), dtype=bool), TREND_RADIUS)
    is_steep = np.hypot(*trend.gradient_at(candidates).T) > STEEP_SHARE * config.profile_max_slope
    if is_steep.any():
        net[is_steep] = net_votes(profiles, z - trend.elevation_at(candidates), config)[is_steep]
    ground = grow_ground(profiles, z, net > AGREEMENT, spacing)
    if ground.any():
        height = z - fit_trend(candidates, ground, TREND_RADIUS).elevation_at(candidates)
        ground = net_votes(profiles, height, config) > AGREEMENT - LESS_ON_TREND
        ground = grow_ground(profiles, z, ground, spacing)
    return reject_outliers(profiles, z, ground, spacing, config)
