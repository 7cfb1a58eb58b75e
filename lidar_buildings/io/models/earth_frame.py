"""Where the map frame lies on the earth: from its coordinates to those around a place on the ellipsoid."""

from __future__ import annotations

import warnings

import numpy as np
import pyproj
from numpy.typing import NDArray
from pyproj.exceptions import CRSError, ProjError

from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.files.reference_systems import GEOCENTRIC, GEODETIC, east_north_up, horizontal_part

#: A vertical system that changes heights by less has no grid here [m].
_NO_CHANGE = 1e-3


class NoPlaceError(LidarBuildingsError):
    """It is not known where on the earth a survey lies."""


class EarthFrame:
    """
    Turns map coordinates into east, north and up at the map's origin.

    Places come from the horizontal system. Where PROJ has the grid of the vertical one, ellipsoidal heights
    come from that; else they are the source's elevations plus a height of the geoid that is given [m]. Both
    systems together cannot be asked without the grid: PROJ then leaves out the change of datum, too, which is
    108 m in the Netherlands. NoPlaceError if the reference system is not known, or PROJ knows no way from it
    to WGS 84.
    """

    def __init__(self, frame: MapFrame, crs: str, geoid_height: float = 0.0) -> None:
        if not frame.crs:
            raise NoPlaceError("the inputs name no reference system")
        self._frame, self._geoid_height = frame, geoid_height
        try:
            horizontal = horizontal_part(frame.crs)
            self._plan = pyproj.Transformer.from_crs(horizontal, GEODETIC, always_xy=True)
            self._geocentric = pyproj.Transformer.from_crs(GEODETIC, GEOCENTRIC, always_xy=True)
            self._spatial = _with_heights(crs, self._plan)
        except (CRSError, ProjError) as error:
            raise NoPlaceError(" ".join(str(error).split())[:200]) from error
        origin = np.zeros((1, 3))
        self.has_grid = False
        if self._spatial is not None:
            change = self._spatial.transform(*frame.to_source(origin)[0])[2] - frame.origin[2]
            self.has_grid = bool(np.isfinite(change) and abs(change) > _NO_CHANGE)
        longitude, latitude, _ = self._geodetic(origin)[0]
        if not np.isfinite([longitude, latitude]).all():
            raise NoPlaceError(f"the map's origin is outside the area of {frame.crs.split(',')[0]}")
        self._origin = self._ecef(origin)[0]
        self._axes = east_north_up(longitude, latitude)

    @property
    def heights(self) -> str:
        """What the heights are, in words."""
        if self.has_grid:
            return "ellipsoidal: turned from the source's elevations by the grid of their vertical system"
        return (
            f"the source's elevations + {self._geoid_height:g} m (model_writer.geoid_height): PROJ has no "
            "grid that turns them into ellipsoidal ones"
        )

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The matrix, shape (4, 4), that turns east, north and up into geocentric coordinates."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self._axes.T, self._origin
        return matrix

    def local(self, map_xyz: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn map coordinates, shape (n, 3), into east, north and up at the map's origin [m]."""
        # column by column: a product of matrices may depend on the number of rows in its last bit
        away = (self._ecef(map_xyz) - self._origin).T
        return np.column_stack([a * away[0] + b * away[1] + c * away[2] for a, b, c in self._axes])

    def _geodetic(self, map_xyz: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return longitude, latitude [deg] and ellipsoidal height [m]."""
        x, y, z = self._frame.to_source(map_xyz).T
        if self.has_grid and self._spatial is not None:
            return np.column_stack(self._spatial.transform(x, y, z))
        longitude, latitude = self._plan.transform(x, y)
        height = map_xyz[:, 2] + self._frame.origin[2] + self._geoid_height
        return np.column_stack([longitude, latitude, height])

    def _ecef(self, map_xyz: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack(self._geocentric.transform(*self._geodetic(map_xyz).T))


def _with_heights(crs: str, plan: pyproj.Transformer) -> pyproj.Transformer | None:
    """Return the way of places and heights together, None where no vertical system is known."""
    compound = pyproj.CRS.from_user_input(crs)
    if len(compound.axis_info) < 3:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return pyproj.Transformer.from_crs(compound, plan.target_crs, always_xy=True)
