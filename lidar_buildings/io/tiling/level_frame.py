"""A level frame on the Earth, x east and y north at its origin, and where its points lie in a map's grid."""

from __future__ import annotations

import math
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
import pyproj
from numpy.typing import NDArray

from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.core.scans.track_fit import TrackFit, fit_track
from lidar_buildings.io.files.reference_systems import GEOCENTRIC, GEODETIC, east_north_up

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

    def placed(self, scan: PlacedScan) -> PlacedScan:
        """Return a scan of the frame in the grid, less `place`."""
        return scan._replace(points=self.in_grid(scan.points))


def grid_coordinates(places: Geodetic, crs: str) -> NDArray[np.float64]:
    """Return where places, arrays of shape (n,) or one, lie in a reference system, shape (n, 3) or (3,)."""
    return np.nan_to_num(np.stack(_way(GEODETIC, crs).transform(*places), axis=-1), posinf=_NOWHERE)


def middle_of(places: Geodetic) -> Geodetic:
    """Return the place amid others, arrays of shape (n,), of which less than half may be anywhere."""
    return _geodetic(np.median(_geocentric(places), axis=0))


def _geodetic(geocentric: NDArray[np.float64]) -> Geodetic:
    x, y, z = geocentric.T
    return Geodetic(*_way(GEOCENTRIC, GEODETIC).transform(x, y, z))


def _geocentric(place: Geodetic) -> NDArray[np.float64]:
    return np.stack(_way(GEODETIC, GEOCENTRIC).transform(*place), axis=-1)


@cache
def _way(source: str, target: str) -> pyproj.Transformer:
    """Return the way between two systems: to make it takes as long as to go it with ten thousand points."""
    return pyproj.Transformer.from_crs(source, target, always_xy=True)
