"""A level frame on the Earth, x east and y north at its origin, and where its points lie in a map's grid."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pyproj
from numpy.typing import NDArray

from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.core.scans.track_fit import TrackFit, fit_track
from lidar_buildings.io.files.reference_systems import GEOCENTRIC, GEODETIC, east_north_up

#: Points within this of the origin are placed to 2 cm, those within a tenth of it to 2 mm [m].
_REACH = 10_000.0
#: Points along a side of the square in which the grid is probed, and the degree of what is fitted to them.
_N_PROBES, _DEGREE = 7, 3
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
    curvature. The grid, in metres, must be conformal: within reach of the origin it is a polynomial of x +
    iy, fitted to what pyproj says.
    """

    def __init__(self, origin: Geodetic, crs: str, yaw: float = 0.0) -> None:
        self.origin, self.crs, self.yaw = origin, crs, yaw
        self._to_grid = pyproj.Transformer.from_crs(GEODETIC, crs, always_xy=True)
        side = np.linspace(-_REACH, _REACH, _N_PROBES)
        probes = np.stack(np.meshgrid(side, side, [0.0]), axis=-1).reshape(-1, 3)
        east, north, _ = self._to_grid.transform(*self.geodetic(probes))
        plan = (probes[:, 0] + 1j * probes[:, 1]) / _REACH
        grid = east - self.place[0] + 1j * (north - self.place[1])
        self._powers = np.linalg.lstsq(np.vander(plan, _DEGREE + 1), grid, rcond=None)[0]

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
        x, y, z = (round(float(one), 3) for one in self._to_grid.transform(*self.origin))
        return x, y, z

    def geodetic(self, points: NDArray[np.float64]) -> Geodetic:
        """Return points of the frame, shape (n, 3) [m], as places: an array a member."""
        return _geodetic(_geocentric(self.origin) + points @ self.axes)

    def in_grid(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points of the frame, shape (n, 3), in the grid, less `place` [m]."""
        x, y, z = points.T
        radius = self._radius
        plan = (x + 1j * y) / (_REACH * (1.0 + z / radius))
        grid = np.polyval(self._powers, plan)
        return np.column_stack([grid.real, grid.imag, z + (x * x + y * y) / (2.0 * (radius + z))])

    def placed(self, scan: PlacedScan) -> PlacedScan:
        """Return a scan of the frame in the grid, less `place`."""
        sensor = None if scan.sensor is None else self.in_grid(scan.sensor[None])[0]
        return scan._replace(points=self.in_grid(scan.points), sensor=sensor)

    @cached_property
    def _radius(self) -> float:
        """Distance of the origin from the middle of the sphere that fits the ellipsoid there best [m]."""
        ellipsoid = pyproj.Geod(ellps="WGS84")
        sine = math.sin(math.radians(self.origin.latitude))
        return ellipsoid.b / (1.0 - ellipsoid.es * sine * sine) + self.origin.height


def middle_of(places: Geodetic) -> Geodetic:
    """Return the place amid others, arrays of shape (n,), of which less than half may be anywhere."""
    return _geodetic(np.median(_geocentric(places), axis=0))


def _geodetic(geocentric: NDArray[np.float64]) -> Geodetic:
    to_geographic = pyproj.Transformer.from_crs(GEOCENTRIC, GEODETIC, always_xy=True)
    x, y, z = geocentric.T
    return Geodetic(*to_geographic.transform(x, y, z))


def _geocentric(place: Geodetic) -> NDArray[np.float64]:
    return np.stack(
        pyproj.Transformer.from_crs(GEODETIC, GEOCENTRIC, always_xy=True).transform(*place), axis=-1
    )
