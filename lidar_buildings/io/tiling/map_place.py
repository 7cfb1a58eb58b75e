"""Where the map of placed scans lies: as it is told, or by satellites."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.core.scans.track_fit import TrackFit, fit_track
from lidar_buildings.io.tiling.level_frame import Geodetic, LevelFrame, grid_coordinates, middle_of

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
        return scan if self.level is None else self.level.placed(scan)

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
            x, y, z = (round(float(one), 3) for one in _beyond_errors(fit.shift))
            said = f"the poses are told in its grid ({math.hypot(*fit.shift[:2]):.2f} m from the fixes)"
            return MapPlace(MapFrame(crs, (x, y, z)), None, *_words(pairs, fit, crs, said))
    x, y, _ = np.median(pairs.track, axis=0)
    if math.hypot(x, y) > _LOCAL:
        said = f"the poses are told in a grid that is not UTM's (x {x:,.0f}, y {y:,.0f}): publish map_origin"
        return MapPlace(warnings=(f"{said}; outputs carry no reference system",))
    crs = zone_of(middle)
    level, fit = LevelFrame.fitted(pairs.track, pairs.seen, pairs.weighed, crs)
    said = f"points {_direction(math.degrees(fit.yaw))} (± {math.degrees(fit.yaw_error):.2f}°)"
    if not fit.tells_yaw:
        said = "is taken for east, as they moved too little to tell"
    words = _words(pairs, fit, crs, f"x of the poses {said}")
    return MapPlace(MapFrame(crs, level.place), level, *words, fit.tells_yaw)


def zone_of(place: Geodetic, by: int = 0) -> str:
    """Return the zone of UTM on WGS 84 in which a place lies, or the one so many further east."""
    zone = (min(int((place.longitude + 180.0) // 6.0), 59) + by) % 60 + 1
    return f"EPSG:{(_NORTH if place.latitude >= 0.0 else _SOUTH) + zone}"


def _direction(degrees: float) -> str:
    return f"{abs(degrees):.2f}° {'north' if degrees > 0.0 else 'south'} of east" if degrees else "east"


def _beyond_errors(shift: _Floats) -> _Floats:
    """Return a shift of poses that are told in the grid; they are as good as fixes where these are near."""
    is_far = np.repeat([math.hypot(*shift[:2]) > _AS_TOLD, abs(shift[2]) > _AS_TOLD], [2, 1])
    return np.where(is_far, shift, 0.0)


def _words(pairs: Pairs, fit: TrackFit, crs: str, said: str) -> tuple[str, tuple[str, ...]]:
    """Say how it was found out, and what is doubtful about that."""
    n, n_used = len(fit.is_used), int(np.count_nonzero(fit.is_used))
    off = f"{fit.rms:.2f} m from the poses, {fit.rms_height:.2f} m in height"
    line = f"the map lies in {crs} by {n_used:,} of {n:,} satellite fixes ({off}); {said}"
    warnings = []
    if fit.rms > pairs.usual or fit.rms_height > 2.0 * pairs.usual:
        warnings.append(
            f"the satellite fixes are {off} (RMS; usual is {pairs.usual:.1f} m): the map may lie wrong by as "
            "much; clocks that differ do that, and odometry that drifts"
        )
    if 3 * n_used < 2 * n:
        warnings.append(f"{n - n_used:,} of {n:,} satellite fixes contradict the others, and are left out")
    return line, tuple(warnings)
