"""Ground grows along profiles by local regression: points join that lines through ground lead to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.stages.ground_filter.scan_profiles.profile_lines import (
    MIN_SPREAD,
    NO_SUMS,
    add_side,
    fitted_line,
    spread_of,
)
from lidar_buildings.core.stages.ground_filter.scan_profiles.profiles import Profiles

# Chosen with `bench.ground.isprs`.
#: How often points next to the ground are tried again, at most.
ROUNDS = 25
#: How far away a line through ground points may begin [multiples of the spacing].
REACH = 6.0
#: By how many lines ground has to lead to a point, more than half of those that lie well below it.
SUPPORT = 2
#: Points this near a line are where it leads to [m]; by how much that grows per unit of slope [m], and per
#: standard deviation of the ground.
TOLERANCE, TOLERANCE_SLOPE, ROUGHNESS = 0.2, 0.3, 1.0
#: Ground points on either side that a line is fitted to.
POINTS = 4
#: Steepest slope that is carried on beyond the points it was fitted to, rise over run.
MAX_SLOPE = 1.0
#: Roughness of the ground adds at most so much to the tolerance [m].
MAX_ROUGHNESS = 0.5
#: A point is against ground if it stands so many tolerances above the line; weights in half votes.
AGAINST = 3.0
FOR_WEIGHT, AGAINST_WEIGHT = 2, -1


def grow_ground(
    profiles: Sequence[Profiles], elevation: NDArray[np.float64], ground: NDArray[np.bool_], spacing: float
) -> NDArray[np.bool_]:
    """
    Return the ground with all points that lines through ground points beside them lead to.

    On every profile a line is fitted to the nearest ground points on either side of a point and carried on to
    it. A point joins where `SUPPORT` more lines lead to it than pass well below it, these counting
    half: at the foot and the top of a slope, one side of it always does. Repeated until no point joins.

    Profiles and elevations are those of `net_votes`, `ground` is what is known so far, `spacing` in [m].
    """
    ground = ground.copy()
    reach = REACH * spacing
    votes = np.zeros((len(profiles), len(ground)), dtype=np.int8)  # so few that their sum is no more
    axes = [_Axis(one, elevation, ground, votes[k]) for k, one in enumerate(profiles)]
    new = np.flatnonzero(ground)

    def judge(begin: int, end: int) -> None:
        for axis in axes[begin:end]:
            axis.judge(new, reach)

    for _ in range(ROUNDS):
        if not len(new):
            break
        for_row_blocks(judge, len(axes), 1)
        new = np.flatnonzero(~ground & (votes.sum(axis=0, dtype=np.int8) >= FOR_WEIGHT * SUPPORT))
        ground[new] = True
    return ground


class _Axis:
    """One set of profiles with the ground and the votes of its lines so far."""

    def __init__(
        self,
        profiles: Profiles,
        elevation: NDArray[np.float64],
        ground: NDArray[np.bool_],
        votes: NDArray[np.int8],
    ) -> None:
        self.profiles = profiles
        self.z = elevation[profiles.rows]
        self.ground = ground[profiles.rows]
        self.place = np.empty(len(self.z), dtype=np.intp)
        self.place[profiles.rows] = np.arange(len(self.z))
        self.line = np.repeat(np.arange(len(profiles.first) - 1), np.diff(profiles.first))
        #: Half votes for each row of the cloud.
        self.votes = votes

    def judge(self, new: NDArray[np.intp], reach: float) -> None:
        """Add new ground and count the lines again of all points within its reach."""
        one = self.profiles
        changed = self.place[new]
        self.ground[changed] = True
        stale = np.zeros(len(self.z), dtype=np.bool_)
        _mark_around(changed, one.along, self.line, self.ground, reach, stale)
        _judge(one.along, self.z, one.first, self.line, self.ground, stale, reach, one.rows, self.votes)


@kernel
def _mark_around(changed, along, line, ground, reach, stale):  # type: ignore[no-untyped-def]
    for i in changed:
        for heading in (-1, 1):
            j = i + heading
            while 0 <= j < len(along) and line[j] == line[i] and abs(along[j] - along[i]) <= reach:
                stale[j] = not ground[j]
                j += heading


@kernel
def _judge(along, z, first, line, ground, stale, reach, rows, votes):  # type: ignore[no-untyped-def]
    for i in range(len(rows)):
        if not stale[i]:
            continue
        vote = 0
        for heading in (-1, 1):
            sums = add_side(
                NO_SUMS, along, z, ground, i, heading, first[line[i]], first[line[i] + 1], POINTS, reach
            )
            if sums[0] < 2 or spread_of(sums) < MIN_SPREAD * sums[0]:
                continue
            height, slope, sigma = fitted_line(sums, MAX_SLOPE)
            margin = TOLERANCE + TOLERANCE_SLOPE * abs(slope) + min(ROUGHNESS * sigma, MAX_ROUGHNESS)
            if height < margin:
                vote += FOR_WEIGHT
            elif height > AGAINST * margin:
                vote += AGAINST_WEIGHT
        votes[rows[i]] = vote
