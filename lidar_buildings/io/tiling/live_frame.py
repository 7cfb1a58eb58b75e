"""Where the map of a feed lies: given, told by others, by satellite, or nowhere."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pyproj

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.scans.placing import ScanPlacer, stamp_of

#: Coordinates of the map beyond this lose more than a centimetre in float32: the origin is moved [m].
_FAR = 50_000.0
#: The origin is moved in steps of this [m].
_STEP = 1_000.0
#: EPSG's numbers of the zones of UTM on WGS 84, north and south of the equator, less the zone.
_NORTH, _SOUTH = 32_600, 32_700
_NO_FIX = -1
#: Time that is given to others to tell where the map lies, since the first points have come [s]; wide margin
#: over the discovery of their publisher. And points after which nobody is waited for any longer.
_PATIENCE, _MOST_EARLY = 2.0, 2_000_000


class Fix(NamedTuple):
    """A sensor_msgs/NavSatFix: time [ns], degrees, and metres above the ellipsoid."""

    stamp: int
    latitude: float
    longitude: float
    altitude: float

    @classmethod
    def of(cls, message: Any) -> Fix | None:
        """Return what a message says, None if it is no fix."""
        numbers = message.latitude, message.longitude, message.altitude
        is_place = all(map(math.isfinite, numbers)) and abs(numbers[0]) <= 90.0 and abs(numbers[1]) <= 180.0
        if message.status.status == _NO_FIX or not is_place:
            return None
        return cls(stamp_of(message.header), *map(float, numbers))


class FrameSearch:
    """
    Settles where the map lies, once the first points have come.

    Parameters
    ----------
    given : MapFrame or None
        Where it lies, if that is known.
    """

    def __init__(self, given: MapFrame | None) -> None:
        self.given = given
        self._fix: Fix | None = None
        self._first_at: float | None = None

    def take_fix(self, message: Any) -> None:
        """Take a sensor_msgs/NavSatFix."""
        self._fix = Fix.of(message) or self._fix

    def take_frame(self, frame: MapFrame) -> None:
        """Take what others say."""
        self.given = self.given or frame

    def settled(self, placer: ScanPlacer, now: float, n_points: int) -> MapFrame | None:
        """
        Return where the map lies, None as long as others may still tell.

        Parameters
        ----------
        placer : ScanPlacer
            Knows the poses.
        now : float
            The time [s]; infinite to wait no longer.
        n_points : int
            That wait for it, one at least.
        """
        self._first_at = min(now, math.inf if self._first_at is None else self._first_at)
        if self.given is None and self._fix is not None:
            self.given = frame_by_fix(self._fix, placer)
        return self.given or (MapFrame() if self.is_over(now, n_points) else None)

    def is_over(self, now: float, n_points: int, patience: float = _PATIENCE) -> bool:
        """Whether points have waited long enough [s], or are too many to wait."""
        first_at = now if self._first_at is None else self._first_at
        return math.isinf(now) or now - first_at >= patience or n_points >= _MOST_EARLY


def frame_by_fix(fix: Fix, placer: ScanPlacer) -> MapFrame | None:
    """
    Return where the map lies by one fix and the pose at its time, None if there is no pose.

    The map's axes are taken to point east and north of the grid.

    Parameters
    ----------
    fix : Fix
        Of the antenna on the vehicle or aircraft.
    placer : ScanPlacer
        Knows the poses.
    """
    place = placer.antenna(fix.stamp)
    if place is None:
        return None
    zone = min(int((fix.longitude + 180.0) // 6.0) + 1, 60)
    crs = f"EPSG:{(_NORTH if fix.latitude >= 0.0 else _SOUTH) + zone}"
    to_grid = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    east, north = to_grid.transform(fix.longitude, fix.latitude)
    x, y, z = (round(float(one), 3) for one in np.array([east, north, fix.altitude]) - place)
    return MapFrame(crs, (x, y, z))


def moved_origin(frame: MapFrame, point: Any) -> MapFrame:
    """Return the frame, with an origin near a point of it if that is far away."""
    if np.abs(point[:2]).max() <= _FAR:
        return frame
    shift = np.round(np.array([point[0], point[1], 0.0]) / _STEP) * _STEP
    x, y, z = (float(one) for one in np.array(frame.origin) + shift)
    return MapFrame(frame.crs, (x, y, z))
