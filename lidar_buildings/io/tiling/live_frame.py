"""Where the map of scans lies: given, told by others, by satellite, or nowhere."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pyproj

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.scans.placing import ScanPlacer, stamp_of
from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.io.tiling.level_frame import Geodetic, LevelFrame

#: Coordinates of the map beyond this lose more than a centimetre in float32: the origin is moved [m].
_FAR = 50_000.0
#: The origin is moved in steps of this [m].
_STEP = 1_000.0
#: EPSG's numbers of the zones of UTM on WGS 84, north and south of the equator, less the zone.
_NORTH, _SOUTH = 32_600, 32_700
_NO_FIX = -1
#: A pose within this of where the fix lies in the grid is told in the grid; a local one is hundreds of
#: kilometres from there, as no zone of UTM has eastings below 160 km [m].
_SAME_PLACE = 10_000.0
#: Time that is given to others to tell where the map lies, since the first points have come [s]; wide margin
#: over the discovery of their publisher. And points after which nobody is waited for any longer.
_PATIENCE, _MOST_EARLY = 2.0, 2_000_000


class Fix(NamedTuple):
    """A sensor_msgs/NavSatFix: time [ns], and place."""

    stamp: int
    place: Geodetic

    @classmethod
    def of(cls, message: Any) -> Fix | None:
        """Return what a message says, None if it is no fix."""
        place = Geodetic(*map(float, (message.longitude, message.latitude, message.altitude)))
        is_place = (
            all(map(math.isfinite, place)) and abs(place.latitude) <= 90.0 and abs(place.longitude) <= 180.0
        )
        if message.status.status == _NO_FIX or not is_place:
            return None
        return cls(stamp_of(message.header), place)


class MapPlace(NamedTuple):
    """Where the map lies."""

    frame: MapFrame = MapFrame()  #: the map's axes are its grid's
    level: LevelFrame | None = None  #: the frame in which scans are placed, if that is not the map's

    def placed(self, scan: PlacedScan) -> PlacedScan:
        """Return a scan in the map."""
        return scan if self.level is None else self.level.placed(scan)


class FrameSearch:
    """
    Settles where the map lies, once the first points have come.

    Parameters
    ----------
    given : MapFrame or None
        Where it lies, if that is known.
    """

    def __init__(self, given: MapFrame | None) -> None:
        self._found = None if given is None else MapPlace(given)
        self._fix: Fix | None = None
        self._first_at: float | None = None

    def take_fix(self, message: Any) -> None:
        """Take a sensor_msgs/NavSatFix."""
        self._fix = Fix.of(message) or self._fix

    def take_frame(self, frame: MapFrame) -> None:
        """Take what others say."""
        self._found = self._found or MapPlace(frame)

    def settled(self, placer: ScanPlacer, now: float, n_points: int) -> MapPlace | None:
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
        if self._found is None and self._fix is not None:
            self._found = place_by_fix(self._fix, placer)
        return self._found or (MapPlace() if self.is_over(now, n_points) else None)

    def is_over(self, now: float, n_points: int, patience: float = _PATIENCE) -> bool:
        """Whether points have waited long enough [s], or are too many to wait."""
        first_at = now if self._first_at is None else self._first_at
        return math.isinf(now) or now - first_at >= patience or n_points >= _MOST_EARLY


def place_by_fix(fix: Fix, placer: ScanPlacer) -> MapPlace | None:
    """
    Return where the map lies by one fix and the pose at its time, None if there is no pose.

    Poses are those of a level frame at their origin, x east and y to true north (REP-103), unless the pose
    lies where the fix does in the grid: then they are told in the grid.

    Parameters
    ----------
    fix : Fix
        Of the antenna on the vehicle or aircraft.
    placer : ScanPlacer
        Knows the poses.
    """
    pose = placer.antenna(fix.stamp)
    if pose is None:
        return None
    zone = min(int((fix.place.longitude + 180.0) // 6.0) + 1, 60)
    crs = f"EPSG:{(_NORTH if fix.place.latitude >= 0.0 else _SOUTH) + zone}"
    in_grid = pyproj.Transformer.from_crs("EPSG:4979", crs, always_xy=True).transform(*fix.place)
    shift = np.array(in_grid) - pose
    if np.hypot(*shift[:2]) <= _SAME_PLACE:
        x, y, z = (round(float(one), 3) for one in shift)
        return MapPlace(MapFrame(crs, (x, y, z)))
    level = LevelFrame.through(pose, fix.place, crs)
    return MapPlace(MapFrame(crs, level.place), level)


def moved_origin(frame: MapFrame, point: Any) -> MapFrame:
    """Return the frame, with an origin near a point of it if that is far away."""
    if np.abs(point[:2]).max() <= _FAR:
        return frame
    shift = np.round(np.array([point[0], point[1], 0.0]) / _STEP) * _STEP
    x, y, z = (float(one) for one in np.array(frame.origin) + shift)
    return MapFrame(frame.crs, (x, y, z))
