"""A tile's stamp: the recorded time of its first point where there is one."""

from __future__ import annotations

import bisect
import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.ids import STEP

#: Seconds of a week: the largest GPS week time.
WEEK = 604_800
#: Unix time of the GPS epoch, 1980-01-06 [s].
GPS_EPOCH = 315_964_800
#: Adjusted standard GPS time is this much less than GPS time (LAS specification) [s].
ADJUSTMENT = 1_000_000_000
#: GPS times at which a leap second came into force since the GPS epoch (IERS Bulletin C).
LEAP_SECONDS = (
    46828800, 78364801, 109900802, 173059203, 252028804, 315187205, 346723206, 393984007, 425520008,
    457056009, 504489610, 551750411, 599184012, 820108813, 914803214, 1025136015, 1119744016, 1167264017
)  # fmt: skip
#: Stamps carry seconds as int32.
LATEST = 2**31 - 1
_NANOSECONDS = 1_000_000_000


def stamp_of_time(gps_time: float, *, is_standard: bool) -> int | None:
    """
    Return the stamp [ns] of a recorded GPS time, None if the time is not plausible, as NaN and 0.

    Seconds of the week stay as they are; adjusted standard time, where the file says that its times are,
    becomes Unix time. Files exist that say week time and hold standard time, so a value longer than a week
    counts as the latter.
    """
    if not math.isfinite(gps_time) or gps_time == 0.0:
        return None
    if not is_standard and gps_time <= WEEK:
        seconds = gps_time
    else:
        seconds = _unix(gps_time + ADJUSTMENT)
        if seconds > LATEST:  # standard time that was not adjusted
            seconds = _unix(gps_time)
    return round(seconds * (_NANOSECONDS // STEP)) * STEP if 0 < seconds < LATEST else None


def stamp_of_number(number: int) -> int:
    """Return the stamp [ns] of tile `number` where no time is known: so many seconds."""
    return number * _NANOSECONDS


def gps_time_of(stamps: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return adjusted standard GPS times [s] of Unix times [ns]; 0 for what lies before the GPS epoch."""
    whole = stamps // _NANOSECONDS - GPS_EPOCH
    # the leap seconds up to a Unix time are those up to it and themselves
    n_leaps = np.searchsorted(np.array(LEAP_SECONDS) - np.arange(len(LEAP_SECONDS)), whole, side="right")
    gps = (whole + n_leaps - ADJUSTMENT) + (stamps % _NANOSECONDS) / _NANOSECONDS
    return np.where(whole > 0, gps, 0.0)


def _unix(gps_seconds: float) -> float:
    return gps_seconds + GPS_EPOCH - bisect.bisect_right(LEAP_SECONDS, gps_seconds)
