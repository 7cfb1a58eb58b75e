"""Satellite positions as they come, and the poses at their times."""

from __future__ import annotations

import math
from collections import deque
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.scans.antenna import Antenna
from lidar_buildings.core.scans.placing import ScanPlacer, stamp_of
from lidar_buildings.core.scans.transform_tree import frame_name
from lidar_buildings.io.tiling.level_frame import Geodetic
from lidar_buildings.io.tiling.map_place import MapPlace, Pairs, place_by_fixes

_NO_FIX = -1
#: The least error that is believed [m].
_LEAST_ERROR = 0.02
#: From UTC to the time of GPS, and of atoms, since 2017; and how much later than poses, or sooner, fixes
#: come [s].
_CLOCKS, _DELAY = (18, 37), 1.5
#: Fixes that tell of the clock for good.
_LEAST_LAGS = 5
_SECOND = 1_000_000_000
#: Fixes that wait for their poses.
_MOST_WAITING = 10_000


class Fix(NamedTuple):
    """A sensor_msgs/NavSatFix."""

    stamp: int  #: [ns]
    place: Geodetic
    frame: str = ""  #: of the antenna
    sigma: float = math.nan  #: standard error to the east and north [m], NaN if it is not told

    @classmethod
    def of(cls, message: Any) -> Fix | None:
        """Return what a message says, None if it is no fix."""
        place = Geodetic(*map(float, (message.longitude, message.latitude, message.altitude)))
        is_place = (
            all(map(math.isfinite, place)) and abs(place.latitude) <= 90.0 and abs(place.longitude) <= 180.0
        )
        if message.status.status == _NO_FIX or not is_place:
            return None
        variance = float(message.position_covariance[0] + message.position_covariance[4]) / 2.0
        is_told = message.position_covariance_type and 0.0 < variance < math.inf
        sigma = max(math.sqrt(variance), _LEAST_ERROR) if is_told else math.nan
        return cls(stamp_of(message.header), place, frame_name(message.header.frame_id), sigma)


class SatelliteFixes:
    """
    Gathers fixes and the poses at their times.

    Times of GPS or of atoms beside poses in UTC, or the other way round, are set right. `n_came` counts the
    fixes that came, `n_usable` those that do not say that they are none.
    """

    def __init__(self) -> None:
        self.n_came = self.n_usable = 0
        self._waiting: deque[Fix] = deque(maxlen=_MOST_WAITING)
        self._lags: list[float] = []
        self._clock: int | None = None
        self._paired: list[tuple[Fix, NDArray[np.float64]]] = []

    def take(self, message: Any, placer: ScanPlacer) -> None:
        """Take a sensor_msgs/NavSatFix; it comes after the poses of an earlier time."""
        self.n_came += 1
        if (fix := Fix.of(message)) is None:
            return
        self.n_usable += 1
        self._waiting.append(fix)
        if self._clock is None and (antenna := Antenna.of(fix.frame, placer)) is not None:
            self._lags.append((fix.stamp - antenna.known_until(placer)) / _SECOND)

    def pair(self, placer: ScanPlacer) -> int:
        """Find the poses of fixes that wait; return how many were found."""
        clock = self._clock
        if clock is None and self._lags:
            clock = _clock_of(float(np.median(self._lags)))
            self._clock = clock if len(self._lags) >= _LEAST_LAGS else None
        waiting, self._waiting = list(self._waiting), deque(maxlen=_MOST_WAITING)
        n_before = len(self._paired)
        for frame in dict.fromkeys(one.frame for one in waiting):
            own = [one for one in waiting if one.frame == frame]
            antenna = Antenna.of(frame, placer)
            if antenna is None:
                self._waiting.extend(own)
                continue
            times = np.array([one.stamp for one in own]) - (clock or 0) * _SECOND
            places, is_known = antenna.places(placer, times)
            self._paired.extend((own[k], places[k]) for k in np.flatnonzero(is_known))
            may_come = ~is_known & (times > antenna.known_until(placer))
            self._waiting.extend(own[k] for k in np.flatnonzero(may_come))
        return len(self._paired) - n_before

    def pairs(self) -> Pairs | None:
        """Return the fixes whose poses were found, in the order of time; None if there are none."""
        if not self._paired:
            return None
        fixes, track = zip(*sorted(self._paired, key=lambda one: one[0].stamp), strict=True)
        seen = Geodetic(*np.array([one.place for one in fixes]).T)
        return Pairs(np.array(track), seen, np.array([one.sigma for one in fixes]))

    def forget(self) -> None:
        """Forget the fixes whose poses were found."""
        self._paired.clear()

    def place(self) -> MapPlace | None:
        """Return where the map lies, None if no fix has a pose."""
        if (pairs := self.pairs()) is None:
            return None
        place = place_by_fixes(pairs)
        n_other = self.n_came - len(self._paired) - len(self._waiting)
        other = f"; {n_other:,} more are none, or have no pose" if n_other and place.said else ""
        return place._replace(said=place.said + other, warnings=(*self._of_clock(), *place.warnings))

    def no_place(self) -> MapPlace:
        """Return that the map lies nowhere, and why, if fixes have come."""
        lag = f": their times are {np.median(self._lags):+.1f} s off those of the poses" if self._lags else ""
        said = f"none of {self.n_usable:,} satellite fixes has a pose at its time{lag}; the map lies nowhere"
        return MapPlace(warnings=(said,) if self.n_usable else ())

    def _of_clock(self) -> tuple[str, ...]:
        if not self._clock:
            return ()
        way = "ahead of" if self._clock > 0 else "behind"
        return (
            f"the clock of the satellite fixes is {abs(self._clock)} s {way} that of the poses, as that of "
            "GPS or of atoms is of UTC: it was set right",
        )


def _clock_of(lag: float) -> int:
    """Return by how much a clock is ahead of another one, if its stamps come ahead by so much [s]."""
    leaps = [sign * one for one in _CLOCKS for sign in (1, -1)]
    return next((one for one in leaps if abs(lag - one) <= _DELAY), 0)
