"""Coordinate reference systems: their horizontal part, their names and units, and from one to another."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pyproj
import shapely
from numpy.typing import NDArray
from pyproj.exceptions import CRSError, ProjError

from lidar_buildings.core.model.bounds import MAX_COORDINATE
from lidar_buildings.core.model.errors import InputError, MessageError
from lidar_buildings.core.model.map_frame import MapFrame

#: Metres per unit: international foot and US survey foot (ISO 19111, EPSG units 9002 and 9003).
FOOT, US_SURVEY_FOOT = 0.3048, 1200.0 / 3937.0
#: Two units this close are the same: a US survey foot is 6e-7 m longer than a foot.
_SAME_UNIT = 1e-7
#: Nobody measures in smaller units, or in larger ones than its inverse [m].
_SMALLEST_UNIT = 1e-6
#: So many points that rise by so many times what they lie apart in plan are in degrees; of such a survey
#: that is a thousand times as much and more.
_N_CLOUD, _STEEP = 100, 100.0


#: WGS 84 with ellipsoidal heights, and geocentric.
GEODETIC, GEOCENTRIC = "EPSG:4979", "EPSG:4978"


def east_north_up(longitude: float, latitude: float) -> NDArray[np.float64]:
    """Return the unit vectors to the east, north and up at a place [deg] as rows, geocentric."""
    east, north = np.radians(longitude), np.radians(latitude)
    sin_l, cos_l, sin_p, cos_p = np.sin(east), np.cos(east), np.sin(north), np.cos(north)
    return np.array(
        [[-sin_l, cos_l, 0.0], [-sin_p * cos_l, -sin_p * sin_l, cos_p], [cos_p * cos_l, cos_p * sin_l, sin_p]]
    )


def is_same_unit(one: float, other: float) -> bool:
    """Whether two units, in metres, are the same."""
    return abs(one - other) < _SAME_UNIT


def unbound(crs: Any) -> Any:
    """Return a system of pyproj itself, without a transformation bound to it."""
    return crs.source_crs if crs.is_bound else crs


def horizontal_part(crs: Any) -> Any:
    """Return the horizontal part of a text or system of pyproj, of bound ones too; CRSError if it is none."""
    crs = unbound(pyproj.CRS.from_user_input(crs))
    return unbound(crs.sub_crs_list[0]) if crs.sub_crs_list else crs


def name_of(crs: Any) -> str:
    """Return ``"EPSG:28992"`` of a system of pyproj, its WKT where it has no code."""
    code = crs.to_epsg()
    return f"EPSG:{code}" if code else str(crs.to_wkt())


def epsg_code(crs: str) -> str:
    """Return the EPSG code of a reference system, empty if it has none."""
    try:
        return str(pyproj.CRS.from_user_input(crs).to_epsg() or "")
    except CRSError:
        return ""


def with_heights(crs: str, vertical: Any) -> str:
    """Return a system together with a vertical one of pyproj as WKT, alone where no such pair is legal."""
    try:
        horizontal = pyproj.CRS.from_user_input(crs)
        name = f"{horizontal.name} + {vertical.name}"
        return str(pyproj.crs.CompoundCRS(name, [horizontal, vertical]).to_wkt())
    except CRSError:
        return crs


def is_in_degrees(crs: str) -> bool:
    """Whether a reference system is known to have longitude and latitude."""
    try:
        return bool(crs) and bool(horizontal_part(crs).is_geographic)
    except CRSError:
        return False


def check_place(frame: MapFrame) -> None:
    """Refuse (MessageError) a map in degrees or of an unknown system, or origin and units of no place."""
    try:
        if frame.crs and horizontal_part(frame.crs).is_geographic:
            raise MessageError(f"{frame.crs[:100]!r} is in degrees: must be in metres or feet")
    except CRSError:
        raise MessageError(
            f"{frame.crs[:100]!r} is not a known reference system: must be like EPSG:28992, or empty"
        ) from None
    if not (np.abs(frame.origin) <= MAX_COORDINATE).all():
        raise MessageError(f"{frame.origin} is not a place on Earth")
    if not ((frame.units >= _SMALLEST_UNIT) & (frame.units <= 1 / _SMALLEST_UNIT)).all():
        raise MessageError(f"{tuple(frame.units.tolist())} are not metres per unit")


def check_metres(label: object, n_points: int, size: Iterable[float]) -> None:
    """Refuse longitude and latitude for x and y: points that rise where they hardly lie apart in plan."""
    east, north, rise = size
    if n_points >= _N_CLOUD and max(east, north) < 1.0 and rise > _STEEP * max(east, north):
        raise InputError(
            f"{label}: its points lie within {east:.3f} of x and {north:.3f} of y, and {rise:.1f} of z: "
            "transform degrees to a reference system in metres first"
        )


def reprojected(geometries: NDArray[Any], source: str, target: str, label: str) -> NDArray[Any]:
    """
    Transform geometries in the plane; x stands before y, longitude before latitude, whatever the systems say.

    Vertices outside the area that the systems know become infinite. InputError, naming the file, if there is
    no way from one system to the other.
    """
    try:
        one, other = horizontal_part(source), horizontal_part(target)
        if one == other:
            return geometries
        transformer = pyproj.Transformer.from_crs(one, other, always_xy=True)
    except (CRSError, ProjError) as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(
            f"{label}: cannot be transformed from {source[:40]} to {target[:40]} ({reason}): "
            "transform the file first"
        ) from error

    def moved(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack(transformer.transform(xy[:, 0], xy[:, 1]))

    return shapely.transform(geometries, moved)
