"""Coordinate reference systems: their horizontal part, their names and units, and from one to another."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pyproj
import shapely
from numpy.typing import NDArray
from pyproj.exceptions import CRSError, ProjError

from lidar_buildings.core.model.bounds import MAX_COORDINATE
from lidar_buildings.core.model.errors import InputError, MessageError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.remarks import Remark

#: Metres per unit: international foot and US survey foot (ISO 19111, EPSG units 9002 and 9003).
FOOT, US_SURVEY_FOOT = 0.3048, 1200.0 / 3937.0
#: Metres per unit → its name in files and messages.
_UNIT_NAMES = {1.0: "metre", FOOT: "foot", US_SURVEY_FOOT: "US survey foot"}
#: Two units this close are the same: a US survey foot is 6e-7 m longer than a foot.
_SAME_UNIT = 1e-7
#: Nobody measures in smaller units, or in larger ones than its inverse [m].
_SMALLEST_UNIT = 1e-6
#: So many points that rise by so many times what they lie apart in plan are in degrees; of such a survey
#: that is a thousand times as much and more.
_N_CLOUD, _STEEP = 100, 100.0
#: A projection that changes lengths by less than this is true to scale: zones of UTM stay below.
TRUE_SCALE = 1e-3
#: Decimals of a projection's scale: a survey that grows a little keeps it.
_SCALE_DECIMALS = 4
#: Lengths are compared over this many units, or metres where a unit is longer.
_SCALE_BASE = 50.0
#: Systems are used so far outside the area that they are made for [degrees]: Bavaria in the zone of UTM west
#: of it.
_BEYOND_AREA = 4.0
#: Frames and systems whose units are remembered.
_KEPT = 16


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


def unit_name(metres: float) -> str:
    """Return what a unit of length is called: ``"US survey foot"``, ``"0.5 m"`` where it has no name."""
    named = (name for unit, name in _UNIT_NAMES.items() if is_same_unit(unit, metres))
    return next(named, f"{metres:g} m")


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


@lru_cache(_KEPT)
def stated_unit(crs: str) -> float | None:
    """Return how many metres a unit of x and y is, as a reference system states it; None without one."""
    try:
        return float(horizontal_part(crs).axis_info[0].unit_conversion_factor) if crs else None
    except (CRSError, IndexError):
        return None


@lru_cache(_KEPT)
def model_frame(frame: MapFrame) -> MapFrame:
    """
    Return the frame of files that have one unit of length, which is its vertical unit.

    That is the unit that the reference system states for x and y, also where the source's heights have
    another one, and where the projection is not true to scale: there x and y alone are as in the source.
    """
    return replace(frame, vertical_unit=stated_unit(frame.crs) or frame.horizontal_unit)


def about_units(frame: MapFrame, bounds: NDArray[np.float64] | None = None) -> list[Remark]:
    """
    Say in a line each what of a frame's units is not as usual.

    `bounds` are least and greatest x and y of the survey in the map frame, shape (2, 2) [m].
    """
    remarks = [] if bounds is None or not np.isfinite(bounds).all() else _about_area(frame, bounds)
    unit, system = model_frame(frame).vertical_unit, frame.crs.split(",")[0]
    scale = frame.horizontal_unit / unit
    if not is_same_unit(scale, 1.0):
        text = (
            f"{system} is not true to scale here: 1 of x and y is {scale:.4f} {unit_name(unit)} on the "
            "ground: lengths, areas and volumes are true, coordinates stay as in the input"
        )
        remarks.append(Remark("not_true_to_scale", text))
    if bounds is not None and len(off := _scale_errors(frame, bounds)) and off.max() > TRUE_SCALE:
        text = (
            f"the scale of {system} varies over the survey: lengths are up to {100.0 * off.max():.2g} % off: "
            "transform it to a system made for this place, or split it"
        )
        remarks.append(Remark("scale_varies", text))
    if not is_same_unit(unit, frame.vertical_unit):
        one, other = unit_name(unit), unit_name(frame.vertical_unit)
        text = (
            f"x and y are in units of 1 {one}, z of 1 {other}: models and attributes have 1 {one} for all, "
            f"clouds and rasters keep z in 1 {other}"
        )
        remarks.append(Remark("mixed_units", text))
    return remarks


def _scale_errors(frame: MapFrame, bounds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return by how much lengths along x and y are off at the corners and in the middle of map bounds."""
    (west, south), (east, north) = (bounds + frame.origin[:2]) / frame.horizontal_unit
    x, y = np.meshgrid(np.linspace(west, east, 3), np.linspace(south, north, 3))
    places = np.column_stack([x.ravel(), y.ravel()])
    units = true_units(frame.crs, places) if frame.crs else np.empty(0)
    return np.abs(units[np.isfinite(units)] / frame.horizontal_unit - 1.0)


def true_scale(crs: str, place: NDArray[np.float64]) -> float:
    """
    Return the length on the ground of a unit of x and y, by that which the system states; 1 if nearly so.

    `place`, shape (2,), is in the system's own units; the mean of those along x and y counts.
    """
    stated = stated_unit(crs)
    if stated is None:
        return 1.0
    scale = round(float(np.sqrt(true_units(crs, place[None]).prod())) / stated, _SCALE_DECIMALS)
    return scale if abs(scale - 1.0) > TRUE_SCALE and scale > 0.0 else 1.0  # not a number: not known


def true_frame(frame: MapFrame) -> MapFrame:
    """
    Return a frame that was told in the system's own units with their length on the ground at its origin.

    Scanners and poses measure true lengths: so does the map, whatever the projection makes of them.
    """
    stated = stated_unit(frame.crs)
    if stated is None or not is_same_unit(stated, frame.horizontal_unit):
        return frame
    x, y, z = frame.origin
    scale = true_scale(frame.crs, np.array([x, y]) / stated)
    return replace(frame, origin=(x * scale, y * scale, z), horizontal_unit=stated * scale)


def _about_area(frame: MapFrame, bounds: NDArray[np.float64]) -> list[Remark]:
    """Say that the middle of map bounds lies where the system is not used, or x and y are swapped."""
    middle = ((bounds.mean(axis=0) + frame.origin[:2]) / frame.horizontal_unit)[:2]
    if is_in_area(frame.crs, middle, _BEYOND_AREA) is not False:
        return []
    why = "is its system another one?"
    if is_in_area(frame.crs, middle[::-1]):
        why = "x and y seem to be swapped: swap them first"
    text = f"the points lie outside the area in which {frame.crs.split(',')[0]} is used: {why}"
    return [Remark("outside_area", text)]


def is_in_area(crs: str, place: NDArray[np.float64], margin: float = 0.0) -> bool | None:
    """Whether a place lies in the area in which a system is used, or so near [deg]; None if not known."""
    area = pyproj.CRS.from_user_input(crs).area_of_use if crs else None
    if area is None:
        return None
    east, north = degrees_at(crs, place)
    is_wrapped = area.west > area.east
    is_after, is_before = east >= area.west - margin, east <= area.east + margin
    is_between = is_after or is_before if is_wrapped else is_after and is_before
    return bool(is_between and area.south - margin <= north <= area.north + margin)


def degrees_at(crs: str, place: NDArray[np.float64]) -> tuple[float, float]:
    """Return longitude and latitude of a place in a system, not finite where there is no such place."""
    try:
        transformer = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    except ProjError:
        return np.nan, np.nan
    east, north = transformer.transform(*place.tolist())
    return east, north


def true_units(crs: str, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return how many metres on the ellipsoid a unit of x, and of y, is at places of a projected system.

    `places` are in the system's own units, shape (n, 2), as is what is returned; NaN where the system says
    nothing of the Earth, or knows no such place.
    """
    unknown = np.full((len(places), 2), np.nan)
    try:
        system = horizontal_part(crs)
        geodetic, ellipsoid = system.geodetic_crs, system.get_geod()
        if not system.is_projected or geodetic is None or ellipsoid is None:
            return unknown
        to_geodetic = pyproj.Transformer.from_crs(system, geodetic, always_xy=True)
    except (CRSError, ProjError):
        return unknown
    half = _SCALE_BASE / max(float(system.axis_info[0].unit_conversion_factor), 1.0) / 2.0
    ends = places[:, None] + half * np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])
    to_degrees = np.degrees(geodetic.axis_info[0].unit_conversion_factor)
    longitude, latitude = to_geodetic.transform(ends[..., 0], ends[..., 1])
    known = np.isfinite(longitude) & np.isfinite(latitude)
    east, north = (np.where(known, one, 0.0) * to_degrees for one in (longitude, latitude))
    first, second = (slice(None), slice(0, None, 2)), (slice(None), slice(1, None, 2))
    *_, metres = ellipsoid.inv(east[first], north[first], east[second], north[second])
    is_known = known[first] & known[second] & (metres > 0.0)
    return np.where(is_known, metres / (2.0 * half), np.nan)


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


#: From longitude, latitude and elevation to height above the ellipsoid, by a geoid's heights [deg, m].
_BY_GRID = (
    '+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=vgridshift +grids="{}" '
    "+multiplier=1 +step +proj=unitconvert +xy_in=rad +xy_out=deg"
)


def geoid_of_grid(grid: str) -> pyproj.Transformer:
    """Open a grid of geoid heights, a file or one that PROJ knows by name; InputError if it is none."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return pyproj.Transformer.from_pipeline(_BY_GRID.format(grid))
    except ProjError:
        raise InputError(
            f"{grid}: PROJ reads no grid of geoid heights from it: give a GeoTIFF or GTX file, or the "
            "geoid's height in metres"
        ) from None
