"""The last look along profiles: ground that stands out on all sides is rejected."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.scan_profiles.profile_lines import (
    MIN_SPREAD,
    NO_SUMS,
    add_side,
    fitted_line,
    spread_of,
)
from lidar_buildings.core.stages.ground_filter.scan_profiles.profiles import Profiles

# Chosen with `bench.ground.isprs`.
#: Ground is rejected that stands so many standard deviations above a line through its neighbours.
REJECTION = 2.0
#: Ground points on either side that a line is fitted to, and how far they may lie [multiples of the spacing].
POINTS, REACH = 6, 10.0
#: Sets of profiles that have to agree before a point is rejected, where there are as many.
MIN_AXES = 3


def reject_outliers(
    profiles: Sequence[Profiles],
    elevation: NDArray[np.float64],
    ground: NDArray[np.bool_],
    spacing: float,
    config: GroundFilterConfig,
) -> NDArray[np.bool_]:
    """
    Return the ground without the points that stand above it on every profile.

    The local linear regression of Shan & Sampath (2005): a line is fitted to the ground points on both sides,
    and a point is rejected if it lies further above it than `profile_step` and than `REJECTION` times
    the standard deviation of those. With several profiles through a point all have to agree, so that a ridge
    or the edge of a terrace, which stand out on most, stay.

    Profiles and elevations are those of `net_votes`, `ground` is what is known so far, `spacing` in [m].
    """
    limits = (REACH * spacing, config.profile_step, REJECTION)
    judged, above = np.zeros((2, len(profiles), len(ground)), dtype=np.bool_)

    def judge(begin: int, end: int) -> None:
        for k in range(begin, end):
            one = profiles[k]
            _stand_out(one.rows, one.first, one.along, elevation, ground, limits, judged[k], above[k])

    for_row_blocks(judge, len(profiles), 1)
    n_judged = judged.sum(axis=0)
    return ground & ((n_judged < min(MIN_AXES, len(profiles))) | (above.sum(axis=0) < n_judged))


@kernel
def _stand_out(rows, first, along, elevation, ground, limits, judged, above):  # type: ignore[no-untyped-def]
    """
    Tell of each point whether it is ground with ground on both sides, and well above the line through it.
    """
    reach, step, rejection = limits
    z, is_ground = elevation[rows], ground[rows]
    for k in range(len(first) - 1):
        begin, end = first[k], first[k + 1]
        for i in range(begin, end):
            if not is_ground[i]:
                continue
            one = add_side(NO_SUMS, along, z, is_ground, i, -1, begin, end, POINTS, reach)
            both = add_side(one, along, z, is_ground, i, 1, begin, end, POINTS, reach)
            n_one, n = one[0], both[0]
            if 0 < n_one < n and n >= 3 and spread_of(both) >= MIN_SPREAD * n:
                height, _, sigma = fitted_line(both, np.inf)
                judged[rows[i]] = True
                above[rows[i]] = height > max(step, rejection * sigma)
