"""Where the map of placed scans lies: given, reported by others, by satellites, or nowhere."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
import pyproj
from numpy.typing import NDArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.scans.placing import Antenna, ScanPlacer, stamp_of
from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.core.scans.track_fit import TrackFit, fit_track
from lidar_buildings.core.scans.transform_tree import WHOLE_CLOCKS, frame_name
from lidar_buildings.io.files.reference_systems import (
    GEOCENTRIC,
    GEODETIC,
    east_north_up,
    true_frame,
)

#: Coordinates of what lies beyond all that a grid can hold [m].
_NOWHERE = 1e8
#: Steps in which the origin is found; each is right to the Earth's curvature times the last one's error.
_STEPS = 5


class Geodetic(NamedTuple):
    """A place on WGS 84: degrees, and metres above the ellipsoid."""

    longitude: Any
    latitude: Any
    height: Any


class LevelFrame:
    """
    A Cartesian frame that touches the Earth: z points up at its origin, x east, y to true north (REP-103).

    It may be turned: x points to `yaw`, counter-clockwise from east [rad]. A map's grid is turned against it
    by the meridian convergence, is of another scale, and its heights, above the ellipsoid, follow the Earth's
    curvature.
    """

    def __init__(self, origin: Geodetic, crs: str, yaw: float = 0.0) -> None:
        self.origin, self.crs, self.yaw = origin, crs, yaw

    @classmethod
    def fitted(
        cls, track: NDArray[np.float64], seen: Geodetic, sigma: NDArray[np.float64], crs: str
    ) -> tuple[LevelFrame, TrackFit]:
        """
        Return the frame in which a track was told by positions that satellites saw at its times.

        The track has shape (n, 3) [m], `seen` arrays of shape (n,); `sigma`, shape (n,), is as for
        `fit_track`.
        """
        geocentric, origin = _geocentric(seen), middle_of(seen)
        for _ in range(_STEPS):
            axes = east_north_up(origin.longitude, origin.latitude)
            fit = fit_track(track, (geocentric - _geocentric(origin)) @ axes.T, sigma)
            origin = _geodetic(_geocentric(origin) + fit.shift @ axes)
        return cls(origin, crs, fit.yaw), fit

    @cached_property
    def axes(self) -> NDArray[np.float64]:
        """Directions of x, y and z in the geocentric frame, a row each."""
        east, north, up = east_north_up(self.origin.longitude, self.origin.latitude)
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        return np.array([cosine * east + sine * north, cosine * north - sine * east, up])

    @cached_property
    def place(self) -> tuple[float, float, float]:
        """Where the origin lies in the grid [m], to the millimetre."""
        x, y, z = grid_coordinates(self.origin, self.crs)
        return round(float(x), 3), round(float(y), 3), round(float(z), 3)

    def geodetic(self, points: NDArray[np.float64]) -> Geodetic:
        """Return points of the frame, shape (n, 3) [m], as places: an array a member."""
        return _geodetic(_geocentric(self.origin) + points @ self.axes)

    def in_grid(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points of the frame, shape (n, 3), in the grid, less `place` [m]."""
        return grid_coordinates(self.geodetic(points), self.crs) - self.place


def grid_coordinates(places: Geodetic, crs: str) -> NDArray[np.float64]:
    """Return where places, arrays of shape (n,) or one, lie in a reference system, shape (n, 3) or (3,)."""
    return np.nan_to_num(np.stack(_way(GEODETIC, crs)(*places), axis=-1), posinf=_NOWHERE)


def middle_of(places: Geodetic) -> Geodetic:
    """Return the place amid others, arrays of shape (n,), of which less than half may be anywhere."""
    return _geodetic(np.median(_geocentric(places), axis=0))


def _geodetic(geocentric: NDArray[np.float64]) -> Geodetic:
    x, y, z = geocentric.T
    return Geodetic(*_way(GEOCENTRIC, GEODETIC)(x, y, z))


def _geocentric(place: Geodetic) -> NDArray[np.float64]:
    return np.stack(_way(GEODETIC, GEOCENTRIC)(*place), axis=-1)


@cache
def _way(source: str, target: str) -> Callable[..., Any]:
    return pyproj.Transformer.from_crs(source, target, always_xy=True).transform


#: EPSG's numbers of the zones of UTM on WGS 84, north and south of the equator, less the zone.
_NORTH, _SOUTH = 32_600, 32_700
#: Poses within this of where the fixes lie in the grid are told in the grid; local ones are hundreds of
#: kilometres from there, as no zone of UTM has eastings below 160 km. Within the other they are as good [m].
_SAME_PLACE, _AS_TOLD = 10_000.0, 10.0
#: Further from their origin poses are of no level frame: there the Earth has fallen away by 800 m [m].
_LOCAL = 100_000.0
#: Distance of fixes from the poses that is usual where they do not tell how good they are; where they do, it
#: is so many standard errors, and this at least [m].
_USUAL, _N_SIGMA, _LEAST = 5.0, 3.0, 1.0
_Floats = NDArray[np.float64]


class Pairs(NamedTuple):
    """Satellite positions and the poses at their times, one at least."""

    track: _Floats  #: where poses say that the antenna was [m], shape (n, 3)
    seen: Geodetic  #: where satellites say it was: arrays of shape (n,)
    #: Standard errors of these to the east and north [m]; NaN where they are not told, shape (n,).
    sigma: _Floats

    @property
    def usual(self) -> float:
        """Distance between the two that is nothing to tell of [m]."""
        told = self.sigma[np.isfinite(self.sigma)]
        return max(_N_SIGMA * math.sqrt(2.0) * float(np.median(told)), _LEAST) if len(told) else _USUAL

    @property
    def weighed(self) -> _Floats:
        """Standard errors, or numbers in proportion to them: those that are not told are like the others."""
        told = self.sigma[np.isfinite(self.sigma)]
        return np.where(np.isfinite(self.sigma), self.sigma, np.median(told) if len(told) else 1.0)


class MapPlace(NamedTuple):
    """Where the map lies."""

    frame: MapFrame = MapFrame()  #: the map's axes are its grid's
    level: LevelFrame | None = None  #: the frame in which scans are placed, if that is not the map's
    said: str = ""  #: how satellites told
    warnings: tuple[str, ...] = ()  #: what is doubtful about that
    is_sure: bool = True  #: whether more of them would tell no more of how the map is turned

    def placed(self, scan: PlacedScan) -> PlacedScan:
        """Return a scan in the map."""
        return scan if self.level is None else scan._replace(points=self.level.in_grid(scan.points))

    def distances(self, pairs: Pairs) -> _Floats:
        """Return how far satellite positions are in plan from where they are by the poses, shape (n,) [m]."""
        track = pairs.track if self.level is None else self.level.in_grid(pairs.track)
        away = grid_coordinates(pairs.seen, self.frame.crs) - self.frame.origin - track
        return np.hypot(away[:, 0], away[:, 1])


def place_by_fixes(pairs: Pairs) -> MapPlace:
    """
    Return where the map lies by satellite positions and the poses at their times.

    Poses are those of a level frame at their origin: x east and y to true north (REP-103), unless the
    positions show that it is turned. Those that lie where these do in the grid of UTM are told in the grid.
    """
    middle = middle_of(pairs.seen)
    for crs in (zone_of(middle, by) for by in (0, -1, 1)):
        in_grid = grid_coordinates(pairs.seen, crs)
        if np.hypot(*np.median(in_grid - pairs.track, axis=0)[:2]) <= _SAME_PLACE:
            fit = fit_track(pairs.track, in_grid, pairs.weighed, may_turn=False)
            # poses that are told in the grid are as good as fixes where these are near
            is_far = np.repeat([math.hypot(*fit.shift[:2]) > _AS_TOLD, abs(fit.shift[2]) > _AS_TOLD], [2, 1])
            x, y, z = (round(float(one), 3) for one in np.where(is_far, fit.shift, 0.0))
            said = f"the poses are in its grid ({math.hypot(*fit.shift[:2]):.2f} m from the fixes)"
            return MapPlace(MapFrame(crs, (x, y, z)), None, *_words(pairs, fit, crs, said))
    x, y, _ = np.median(pairs.track, axis=0)
    if math.hypot(x, y) > _LOCAL:
        said = f"the poses are in a grid other than UTM (x {x:,.0f}, y {y:,.0f}): publish map_origin"
        return MapPlace(warnings=(f"{said}; outputs have no reference system",))
    crs = zone_of(middle)
    level, fit = LevelFrame.fitted(pairs.track, pairs.seen, pairs.weighed, crs)
    degrees = math.degrees(fit.yaw)
    way = f"{abs(degrees):.2f}° {'north' if degrees > 0.0 else 'south'} of east" if degrees else "east"
    said = f"points {way} (± {math.degrees(fit.yaw_error):.2f}°)"
    if not fit.tells_yaw:
        said = "is assumed to be east, as they moved too little to measure it"
    words = _words(pairs, fit, crs, f"x of the poses {said}")
    return MapPlace(MapFrame(crs, level.place), level, *words, fit.tells_yaw)


def zone_of(place: Geodetic, by: int = 0) -> str:
    """Return the zone of UTM on WGS 84 in which a place lies, or the one so many further east."""
    zone = (min(int((place.longitude + 180.0) // 6.0), 59) + by) % 60 + 1
    return f"EPSG:{(_NORTH if place.latitude >= 0.0 else _SOUTH) + zone}"


def _words(pairs: Pairs, fit: TrackFit, crs: str, said: str) -> tuple[str, tuple[str, ...]]:
    n, n_used = len(fit.is_used), int(np.count_nonzero(fit.is_used))
    off = f"{fit.rms:.2f} m from the poses, {fit.rms_height:.2f} m in height"
    line = f"the map lies in {crs} by {n_used:,} of {n:,} satellite fixes ({off}); {said}"
    warnings = []
    if fit.rms > pairs.usual or fit.rms_height > 2.0 * pairs.usual:
        warnings.append(
            f"the satellite fixes are {off} (RMS; {pairs.usual:.1f} m is usual): the map may be off by as "
            "much; different clocks or drifting odometry cause this"
        )
    if 3 * n_used < 2 * n:
        warnings.append(f"{n - n_used:,} of {n:,} satellite fixes contradict the others and are left out")
    return line, tuple(warnings)


_NO_FIX = -1
#: The least error that is believed [m].
_LEAST_ERROR = 0.02
#: How much later than poses, or sooner, fixes come [s]; and how many fixes settle it.
_DELAY, _N_LAGS = 1.5, 5
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
    """Pairs fixes with poses (`n_came`, of which `n_usable` are valid); corrects clocks of GPS and TAI."""

    def __init__(self) -> None:
        self.n_came = self.n_usable = 0
        self._waiting: deque[Fix] = deque(maxlen=_MOST_WAITING)
        #: By how much the first fixes are ahead of the poses, and the offset of their clock [s].
        self._lags: list[float] = []
        self._clock = 0
        self._paired: list[tuple[Fix, NDArray[np.float64]]] = []

    def take(self, message: Any, placer: ScanPlacer) -> None:
        """Take a sensor_msgs/NavSatFix; it comes after the poses of an earlier time."""
        self.n_came += 1
        if (fix := Fix.of(message)) is None:
            return
        self.n_usable += 1
        self._waiting.append(fix)
        if len(self._lags) < _N_LAGS and (antenna := Antenna.of(fix.frame, placer)) is not None:
            self._lags.append((fix.stamp - antenna.known_until(placer)) / _SECOND)
            lag, clocks = (
                float(np.median(self._lags)),
                (sign * one for one in WHOLE_CLOCKS for sign in (1, -1)),
            )
            self._clock = next((one for one in clocks if abs(lag - one) <= _DELAY), 0)

    def pair(self, placer: ScanPlacer) -> int:
        """Find the poses of fixes that wait; return how many were found."""
        waiting, self._waiting = list(self._waiting), deque(maxlen=_MOST_WAITING)
        n_before = len(self._paired)
        for frame in dict.fromkeys(one.frame for one in waiting):
            own = [one for one in waiting if one.frame == frame]
            antenna = Antenna.of(frame, placer)
            if antenna is None:
                self._waiting.extend(own)
                continue
            times = np.array([one.stamp for one in own]) - self._clock * _SECOND
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

    def place(self) -> MapPlace | None:
        """Return where the map lies, None if no fix has a pose."""
        if (pairs := self.pairs()) is None:
            return None
        place = place_by_fixes(pairs)
        n_other = self.n_came - len(self._paired) - len(self._waiting)
        other = f"; {n_other:,} more are invalid, or have no pose" if n_other and place.said else ""
        way = "ahead of" if self._clock > 0 else "behind"
        clock = (
            f"the clock of the satellite fixes is {abs(self._clock)} s {way} that of the poses, like GPS or "
            "TAI against UTC: corrected"
        )
        warnings = ((clock,) if self._clock else ()) + place.warnings
        return place._replace(said=place.said + other, warnings=warnings)

    def forget(self) -> None:
        """Forget the fixes whose poses were found."""
        self._paired.clear()

    def no_place(self) -> MapPlace:
        """Return that the map lies nowhere, and why, if fixes have come."""
        lag = ""
        if self._lags:
            lag = f": their times differ from those of the poses by {np.median(self._lags):+.1f} s"
        said = f"none of {self.n_usable:,} satellite fixes has a pose at its time{lag}; the map is unplaced"
        return MapPlace(warnings=(said,) if self.n_usable else ())


#: Coordinates of the map beyond this lose more than a centimetre in float32: the origin moves in steps [m].
_FAR, _STEP = 50_000.0, 1_000.0
#: Time that others have to say where the map lies after the first points [s], and fixes to show how it is
#: turned; wide margin over the discovery of a publisher. With so many points nobody is waited for.
_PATIENCE, _FIX_PATIENCE, _MOST_EARLY = 2.0, 10.0, 2_000_000
#: So many later fixes are compared with the poses together; reported again when they are twice as far off.
_N_LATER, _WORSE = 20, 2.0


class FrameSearch:
    """
    Settles where the map of a feed lies, unless it is given, once the first points have come.

    Points that come `in_grid` have its lengths, all others true ones.
    """

    def __init__(self, given: MapFrame | None, *, in_grid: bool = False) -> None:
        self._in_grid = in_grid
        self._found: MapPlace | None = None
        self.fixes = SatelliteFixes()  #: they come after the poses that came before them
        self._by_fixes: MapPlace | None = None
        self._first_at: float | None = None
        self._off = 0.0
        if given is not None:
            self.take_frame(given)

    def take_frame(self, frame: MapFrame) -> None:
        """Take what others say."""
        self._found = self._found or MapPlace(frame if self._in_grid else true_frame(frame))

    def settled(self, placer: ScanPlacer, now: float, n_points: int) -> MapPlace | None:
        """
        Return where the map lies, None as long as others may still tell, or fixes tell more.

        The placer knows the poses; so many points, one at least, wait for it. A time `now` [s] that is
        infinite has it wait no longer.
        """
        self._first_at = min(now, math.inf if self._first_at is None else self._first_at)
        if self._found is None and self.fixes.pair(placer):
            self._by_fixes = self.fixes.place()
        is_last = self.is_over(now, n_points, _FIX_PATIENCE if self.fixes.n_usable else _PATIENCE)
        is_sure = self._by_fixes is not None and self._by_fixes.is_sure and self.is_over(now, n_points)
        if self._found is None and (is_sure or is_last):
            self._found = self._by_fixes or self.fixes.no_place()
            self.fixes.forget()
        return self._found

    def doubts(self, place: MapPlace, placer: ScanPlacer) -> list[str]:
        """Return how later fixes contradict the place that the first ones gave; again if it gets worse."""
        if place.level is None and not place.said:
            return []
        self.fixes.pair(placer)
        pairs = self.fixes.pairs()
        if pairs is None or len(pairs.sigma) < _N_LATER:
            return []
        self.fixes.forget()
        off = float(np.median(place.distances(pairs)))
        if off <= max(pairs.usual, _WORSE * self._off):
            return []
        self._off = off
        return [
            f"satellite fixes are now {off:.1f} m from the poses as placed by the first fixes: the "
            "odometry drifts or restarted, or it moved too little at first to determine its heading"
        ]

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
