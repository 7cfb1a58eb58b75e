"""Side and point spacing of a feed's tiles, by how densely its scanner covers what it leaves behind."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.cell_grid import cell_numbers
from lidar_buildings.core.neighbours.point_spacing import rounded_spacing
from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.io.tiling.point_log import records_of
from lidar_buildings.io.tiling.survey_spacing import expected_spacing, pulses_of
from lidar_buildings.io.tiling.tile_grid import BUFFER_SHARES

#: Time of a feed whose points tell these [s].
PERIOD = 2.0
#: A place is left behind when so long before the period's end no point fell into it [s]: an airborne scanner
#: passes over it once, one on the street comes back to it with each turn.
_LEFT = 0.5
#: Side of a place [m].
_PLACE = 5.0
#: Points that one strip is to bring into a tile with its buffer; further strips and those across bring more.
_STRIP_POINTS = 600_000
#: Sides to choose from are multiples of the step, between the smallest and the largest [m]. Smaller tiles are
#: mostly buffer, and a scanner on the street goes on measuring what it has measured.
_SMALLEST, _LARGEST, _STEP = 150.0, 1000.0, 25.0
_SECOND = 1e9


class FeedScale(NamedTuple):
    """What holds for all tiles of a feed."""

    side: float  #: of tiles [m]
    #: The point spacing that tiles are expected to have [m]; None: nothing tells, and each has its own.
    spacing: float | None


def scale_of(scans: Sequence[PlacedScan], buffer: float, *, is_end: bool = False) -> FeedScale | None:
    """
    Choose the side of tiles, and measure their spacing; None as long as too little has come.

    Both by what the scanner has left behind in the first `PERIOD`. One that goes on measuring what it has
    measured tells no spacing: its tiles become denser than what it shows in a short time. `buffer` is the
    width of the strip of neighbours east of a tile [m]; at the end nothing more is waited for.
    """
    times = np.concatenate([scan.times for scan in scans])
    end = times[0] + round(PERIOD * _SECOND)
    if not is_end and times.max() < end:
        return None
    is_early = times <= end
    xy = np.concatenate([scan.points[:, :2] for scan in scans])[is_early]
    is_left, area = _left_behind(xy, times[is_early])
    if 2 * np.count_nonzero(is_left) < len(xy):
        return FeedScale(_SMALLEST, None)
    around = buffer * (BUFFER_SHARES[0] + BUFFER_SHARES[2])
    widest = math.sqrt(_STRIP_POINTS * area / np.count_nonzero(is_left)) - around
    side = min(max(math.floor(widest / _STEP) * _STEP, _SMALLEST), _LARGEST)
    pulses = pulses_of(np.concatenate([records_of(scan) for scan in scans])[is_early][is_left])
    spacing = expected_spacing([pulses])
    return FeedScale(side, None if spacing is None else rounded_spacing(spacing))


def _left_behind(xy: NDArray[np.float64], times: NDArray[np.int64]) -> tuple[NDArray[np.bool_], float]:
    """Tell which points lie in places left behind, and the area of these [m²]."""
    places, place = np.unique(cell_numbers(xy, _PLACE), return_inverse=True)
    last = np.full(len(places), np.iinfo(np.int64).min)
    np.maximum.at(last, place, times)
    is_left = last < times.max() - round(_LEFT * _SECOND)
    return is_left[place], float(np.count_nonzero(is_left) * _PLACE**2)
