"""Labels along profiles: ground or object, by slope and elevation difference, forth and back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.scan_profiles.profiles import Profiles

#: What a pass says of a point, in half votes; likely ground may yet turn out to be the roof that it began on.
OBJECT, UNKNOWN, LIKELY, GROUND = -2, 0, 1, 2
# Chosen with `bench.ground.isprs`.
#: Where a profile's beginning falls by more than this, it began on an object [m].
FALL = 1.5
#: How steeply the ground behind an object may lie above the ground before it, rise over run.
REENTRY_SLOPE = 0.05
#: How far back along a profile a rise is looked for [m].
WINDOW = 1.0
#: Distance over which a pass forgets the slope of the ground that it came over [m].
SLOPE_MEMORY = 10.0
#: Steps shorter than this say little about the slope [m].
MIN_RUN = 0.5
#: Steepest slope that a pass expects to go on behind an object, rise over run.
MAX_TREND = 1.0


def net_votes(
    profiles: Sequence[Profiles], elevation: NDArray[np.float64], config: GroundFilterConfig
) -> NDArray[np.float64]:
    """
    Return by how much more passes call a point ground than object, as a share of all passes: −1 to 1.

    Each set of profiles is walked forth and back (Shan & Sampath 2005). A point is object from where the
    profile rises by a step until it has come back to the elevation of the last ground point; so what lies
    between a rise and a fall is object in both directions, and what lies above a single step, such as a
    terrace, in one. Elevations may be heights above a trend.
    """
    limits = config.profile_max_slope, config.profile_step, config.profile_max_object, WINDOW
    z = np.ascontiguousarray(elevation)
    votes = np.zeros((len(profiles), len(z)), dtype=np.int8)

    def label(begin: int, end: int) -> None:
        for k in range(begin, end):
            one = profiles[k]
            _label_both_ways(one.rows, one.first, one.along, z, limits, votes[k])

    for_row_blocks(label, len(profiles), 1)
    return votes.sum(axis=0, dtype=np.int64) / (2.0 * GROUND * max(len(profiles), 1))


@kernel
def _label_both_ways(rows, first, along, elevation, limits, votes):  # type: ignore[no-untyped-def]
    z = elevation[rows]
    label = np.empty(len(rows), dtype=np.int8)
    for heading in (1, -1):
        for k in range(len(first) - 1):
            if first[k] < first[k + 1]:
                _walk(along, z, first[k], first[k + 1], heading, limits, label)
        for i in range(len(rows)):
            votes[rows[i]] += label[i]


@kernel
def _walk(along, z, begin, end, heading, limits, label):  # type: ignore[no-untyped-def]
    """
    Label one profile in one direction.

    The first points are likely ground, until the profile falls by more than the terrain can: then they were
    on an object, and nothing is said of them. Where it has gone on for longer than any object, ground is
    sure, that on the way there too.
    """
    max_slope, step, max_object, _ = limits
    i = begin if heading > 0 else end - 1
    start, last = i, i
    on_ground, standing, slope = True, LIKELY, 0.0
    label[i] = LIKELY
    for _ in range(end - begin - 1):
        i += heading
        run = abs(along[i] - along[last])
        if on_ground and _rises(along, z, i, last, begin, end, heading, limits, label):
            on_ground = False
            label[i] = OBJECT
            continue
        if not on_ground and z[i] > z[last] + step + (max(slope, 0.0) + REENTRY_SLOPE) * run:
            label[i] = OBJECT
            if run > max_object:
                # No object is as long, or the longest was not known: unknown until it goes on as far again.
                label[i] = UNKNOWN
                start, last, on_ground, standing, slope = i, i, True, UNKNOWN, 0.0
            continue
        steepest = max_slope if on_ground else REENTRY_SLOPE + max(-slope, 0.0)
        if standing != GROUND and abs(along[i] - along[start]) > max_object:
            _change(label, start, i, heading, LIKELY, GROUND)
            standing = GROUND
        if standing != GROUND and z[last] - z[i] > _fallen(steepest, run, on_ground):
            _change(label, start, i, heading, LIKELY, UNKNOWN)
            start, standing = i, LIKELY
        if on_ground:
            weight = min(1.0, run / SLOPE_MEMORY)
            slope += weight * ((z[i] - z[last]) / max(run, MIN_RUN) - slope)
            slope = min(max(slope, -MAX_TREND), MAX_TREND)
        label[i] = standing
        on_ground, last = True, i


@kernel
def _fallen(steepest, run, on_ground):  # type: ignore[no-untyped-def]
    """Return by how much a profile has to fall until what came before was no ground [m]."""
    return max(FALL, steepest * run) if on_ground else FALL + steepest * run


@kernel
def _rises(along, z, i, last, begin, end, heading, limits, label):  # type: ignore[no-untyped-def]
    """
    Whether point i stands a step above the last ground point, or above one not much further back.

    In dense clouds a step spreads over several points; looking back over a fixed distance finds it all the
    same.
    """
    max_slope, step, _, window = limits
    j = last
    while begin <= j < end:
        run, rise = abs(along[i] - along[j]), z[i] - z[j]
        if run > window and j != last:
            return False
        if label[j] != OBJECT and rise > step and rise > max_slope * run:
            return True
        j -= heading
    return False


@kernel
def _change(label, start, end, heading, before, after):  # type: ignore[no-untyped-def]
    i = start
    while i != end:
        if label[i] == before:
            label[i] = after
        i += heading
