"""Where the map of live scans lies: given, told by others, by satellites, or nowhere."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.scans.placing import ScanPlacer
from lidar_buildings.io.tiling.map_place import MapPlace, SatelliteFixes

#: Coordinates of the map beyond this lose more than a centimetre in float32: the origin is moved [m].
_FAR = 50_000.0
#: The origin is moved in steps of this [m].
_STEP = 1_000.0
#: Time that is given to others to tell where the map lies, since the first points have come [s]; wide margin
#: over the discovery of their publisher. And to fixes, to tell how it is turned. And points after which
#: nobody is waited for any longer.
_PATIENCE, _FIX_PATIENCE, _MOST_EARLY = 2.0, 10.0, 2_000_000
#: Later fixes that are looked at together; they are told of again when they are so many times as far off.
_N_LATER, _WORSE = 20, 2.0


class FrameSearch:
    """Settles where the map lies, unless it is given, once the first points have come."""

    def __init__(self, given: MapFrame | None) -> None:
        self._found = None if given is None else MapPlace(given)
        self._fixes = SatelliteFixes()
        self._by_fixes: MapPlace | None = None
        self._first_at: float | None = None
        self._doubts: list[str] = []
        self._off = 0.0

    def take_fix(self, message: Any, placer: ScanPlacer) -> None:
        """Take a sensor_msgs/NavSatFix, after the poses that came before it."""
        self._fixes.take(message, placer)

    def take_frame(self, frame: MapFrame) -> None:
        """Take what others say."""
        self._found = self._found or MapPlace(frame)

    def settled(self, placer: ScanPlacer, now: float, n_points: int) -> MapPlace | None:
        """
        Return where the map lies, None as long as others may still tell, or fixes tell more.

        The placer knows the poses; so many points, one at least, wait for it. A time `now` [s] that is
        infinite has it wait no longer.
        """
        self._first_at = min(now, math.inf if self._first_at is None else self._first_at)
        if self._found is None and self._fixes.pair(placer):
            self._by_fixes = self._fixes.place()
        is_last = self.is_over(now, n_points, _FIX_PATIENCE if self._fixes.n_usable else _PATIENCE)
        is_sure = self._by_fixes is not None and self._by_fixes.is_sure and self.is_over(now, n_points)
        if self._found is None and (is_sure or is_last):
            self._found = self._by_fixes or self._fixes.no_place()
            self._fixes.forget()
            self._doubts += self._found.warnings
        return self._found

    def doubts(self, place: MapPlace, placer: ScanPlacer) -> list[str]:
        """Return what is new that is doubtful about where the map lies, by fixes that came since, too."""
        found, self._doubts = self._doubts, []
        if place.level is not None or place.said:
            self._fixes.pair(placer)
        pairs = self._fixes.pairs()
        if pairs is None or len(pairs.sigma) < _N_LATER:
            return found
        self._fixes.forget()
        off = float(np.median(place.distances(pairs)))
        if off > max(pairs.usual, _WORSE * self._off):
            self._off = off
            found.append(
                f"satellite fixes are now {off:.1f} m from the poses as placed by the first fixes: the "
                "odometry drifts or restarted, or it moved too little at first to determine its heading"
            )
        return found

    def is_over(self, now: float, n_points: int, patience: float = _PATIENCE) -> bool:
        """Whether points have waited long enough [s], or are too many to wait."""
        first_at = now if self._first_at is None else self._first_at
        return math.isinf(now) or now - first_at >= patience or n_points >= _MOST_EARLY


def moved_origin(frame: MapFrame, point: Any) -> MapFrame:
    """Return the frame, with an origin near a point of it if that is far away."""
    if np.abs(point[:2]).max() <= _FAR:
        return frame
    shift = np.round(np.array([point[0], point[1], 0.0]) / _STEP) * _STEP
    x, y, z = (float(one) for one in np.array(frame.origin) + shift)
    return replace(frame, origin=(x, y, z))
