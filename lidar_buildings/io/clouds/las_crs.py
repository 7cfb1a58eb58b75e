"""The coordinate reference system that a LAS file states, by WKT text or GeoTIFF keys."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
from numpy.typing import NDArray
from pyproj.exceptions import CRSError

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.remarks import Remark
from lidar_buildings.io.clouds.las_records import RawRecord
from lidar_buildings.io.files.failures import warn_once
from lidar_buildings.io.files.reference_systems import (
    FOOT,
    US_SURVEY_FOOT,
    check_metres,
    degrees_at,
    horizontal_part,
    is_in_area,
    is_same_unit,
    name_of,
    unbound,
    unit_name,
)

#: Records whose meaning is kept: files of a survey say the same, and to understand it takes most of the time
#: in which a file is opened.
_KEPT = 64
_PROJECTION = b"LASF_Projection"
_WKT, _GEO_KEYS = 2112, 34735

# GeoTIFF 1.1 keys (OGC 19-008r4)
_MODEL_TYPE, _GEODETIC_CRS, _PROJECTED_CRS = 1024, 2048, 3072
_LINEAR_UNITS, _VERTICAL_CRS, _VERTICAL_UNITS = 3076, 4096, 4099
_GEOGRAPHIC_MODEL = 2
#: Systems that put a point this close together are one [degrees]: about 10 m, less than datums differ by.
_SAME_PLACE = 1e-4
#: Range of keys that are EPSG codes; 32767 means user-defined.
_EPSG_CODES = range(1024, 32767)
#: Metres per unit, by EPSG code: metre, international foot, US survey foot.
_UNITS = {9001: 1.0, 9002: FOOT, 9003: US_SURVEY_FOOT}


@dataclass(frozen=True)
class SourceCrs:
    """What is known of a file's coordinates."""

    name: str = ""  #: ``"EPSG:28992"`` (of the horizontal part), a WKT text where no code is known, or empty
    #: Metres per unit of x and y, and of z. A file that says nothing of heights has them in the horizontal
    #: unit.
    horizontal_unit: float = 1.0
    vertical_unit: float = 1.0
    is_projected: bool = True  #: false for longitude and latitude, and for geocentric coordinates
    doubt: str = ""  #: why the file's own statement was not believed
    states_heights: bool = False  #: whether it says in which unit z is


def source_crs(
    records: Sequence[RawRecord], *, prefer_wkt: bool, label: str, place: NDArray[np.float64] | None = None
) -> tuple[SourceCrs, tuple[Remark, ...]]:
    """
    Read the reference system from a file's plain and extended records; `label` names it in the log.

    A record that cannot be understood is no reason to refuse the points: it is logged, and the other kind of
    record or an unknown system in metres takes its place. Where both kinds can be understood and say
    different things, the one counts in whose area `place`, shape (2,), lies, then the preferred one; which
    it was is said in a remark.
    """
    stated: dict[str, SourceCrs] = {}
    readers = [("WKT", _WKT, _from_wkt), ("GeoTIFF keys", _GEO_KEYS, _from_geo_keys)]
    for kind, record_id, reader in readers if prefer_wkt else reversed(readers):
        for record in records:
            if kind in stated or not record.is_a(_PROJECTION, record_id):
                continue
            try:
                stated[kind] = reader(record.data)
            except (CRSError, ValueError, struct.error, LookupError) as error:
                reason = " ".join(str(error).split())[:200]
                warn_once(f"{label}: its coordinate reference system is not understood ({reason})")
    if not stated:
        return SourceCrs(), ()
    found, remarks = _better(stated, label, place) if len(stated) > 1 else (next(iter(stated.values())), ())
    if found.doubt:
        warn_once(f"{label}: {found.doubt}")
    return found, remarks


def _better(
    stated: dict[str, SourceCrs], label: str, place: NDArray[np.float64] | None
) -> tuple[SourceCrs, tuple[Remark, ...]]:
    """Return what to believe of two statements, the preferred one first, and what is odd about them."""
    (first, one), (second, other) = stated.items()
    if not _is_same(one, other, place):
        fits = [place is not None and bool(is_in_area(crs.name, place)) for crs in (one, other)]
        is_other = fits == [False, True] or not one.name
        why = ", as the points lie in its area" if fits[0] != fits[1] else ""
        said = f"is in {_words(one)} by its {first}, in {_words(other)} by its {second}"
        taken = (other, second) if is_other else (one, first)
        return taken[0], (_remark(f"{label}: {said}: taking the {taken[1]}{why}"),)
    if (
        one.states_heights
        and other.states_heights
        and not is_same_unit(one.vertical_unit, other.vertical_unit)
    ):
        units = [f"{unit_name(crs.vertical_unit)} by its {kind}" for kind, crs in stated.items()]
        return one, (_remark(f"{label}: has z in {units[0]}, in {units[1]}: taking the {first}"),)
    # what says more counts
    named = one if one.name else other
    of_heights = other if other.states_heights and not one.states_heights else one
    return replace(
        named, vertical_unit=of_heights.vertical_unit, states_heights=of_heights.states_heights
    ), ()


def _remark(text: str) -> Remark:
    return Remark("two_reference_systems", f"{text}; export the file again if that is wrong")


def _words(crs: SourceCrs) -> str:
    name = crs.name.split(",")[0] if crs.name else "no named system"
    return f"{name} (unit {unit_name(crs.horizontal_unit)})"


def _is_same(one: SourceCrs, other: SourceCrs, place: NDArray[np.float64] | None) -> bool:
    """Whether two statements are the same in plan; one that names no system says its unit alone."""
    if not is_same_unit(one.horizontal_unit, other.horizontal_unit):
        return False
    if place is None or not (one.name and other.name) or one.name == other.name:
        return True
    there = np.array([degrees_at(crs.name, place) for crs in (one, other)])
    return bool(np.abs(there[0] - there[1]).max() < _SAME_PLACE)  # false of what is not finite


def metric_crs(
    path: Path, crs: SourceCrs, n_points: int, mins: NDArray[np.float64], maxs: NDArray[np.float64]
) -> SourceCrs:
    """Refuse longitude and latitude; doubt a record that says so of coordinates that cannot be."""
    if crs.is_projected:
        check_metres(path, n_points, maxs - mins)
        return crs
    if max(np.abs(mins[:2]).max(), np.abs(maxs[:2]).max()) > 360.0 and crs.horizontal_unit != 1.0:
        warn_once(
            f"{path}: names {crs.name}, but its coordinates are not degrees: assuming unknown, in metres"
        )
        return SourceCrs()
    raise InputError(
        f"{path}: its coordinates are not projected ({crs.name.split(',')[0]}): "
        "transform it to a projected system in metres or feet first"
    )


def vertical_crs(records: Sequence[RawRecord]) -> Any:
    """Return the vertical reference system that a file states, as pyproj has it; None if it states none."""
    for record in records:
        try:
            found = None
            if record.is_a(_PROJECTION, _WKT):
                found = _vertical_part(_wkt_in(record.data))
            elif record.is_a(_PROJECTION, _GEO_KEYS):
                code = _keys_in(record.data).get(_VERTICAL_CRS)
                found = pyproj.CRS.from_epsg(code) if code in _EPSG_CODES else None
            if found is not None and found.is_vertical:
                return found
        except (CRSError, ValueError, struct.error):  # said already when the file was opened
            continue
    return None


def _vertical_part(crs: Any) -> Any:
    parts = unbound(crs).sub_crs_list
    return unbound(parts[1]) if len(parts) > 1 else None


@lru_cache(maxsize=_KEPT)
def _from_wkt(data: bytes) -> SourceCrs:
    return described(_wkt_in(data))


@lru_cache(maxsize=_KEPT)
def _wkt_in(data: bytes) -> Any:
    text = data.split(b"\0")[0].decode("utf-8").strip()
    if not text:
        raise ValueError("its WKT text is empty")
    return pyproj.CRS.from_wkt(text)


def described(crs: Any) -> SourceCrs:
    """Say what matters here of a reference system, compound and bound ones included."""
    horizontal, vertical = horizontal_part(crs), _vertical_part(crs)
    axes = horizontal.axis_info
    if not axes:
        raise ValueError("it names no axes")
    horizontal_unit = axes[0].unit_conversion_factor
    vertical_axes = axes[2:3] if vertical is None else vertical.axis_info
    vertical_unit = vertical_axes[0].unit_conversion_factor if vertical_axes else horizontal_unit
    is_projected = not (horizontal.is_geographic or horizontal.is_geocentric)
    units = float(horizontal_unit), float(vertical_unit)
    return SourceCrs(name_of(horizontal), *units, is_projected, states_heights=bool(vertical_axes))


@lru_cache(maxsize=_KEPT)
def _from_geo_keys(data: bytes) -> SourceCrs:
    keys = _keys_in(data)
    if not keys:
        raise ValueError("its GeoTIFF directory contains no keys")
    crs = _horizontal_from_keys(keys)
    vertical = _vertical_unit_from_keys(keys)
    states_heights = crs.states_heights or vertical is not None
    return replace(crs, vertical_unit=vertical or crs.vertical_unit, states_heights=states_heights)


def _keys_in(data: bytes) -> dict[int, int]:
    """Return the keys of a GeoTIFF directory that hold a number."""
    entries = [struct.unpack_from("<4H", data, at) for at in range(8, len(data) - 7, 8)]
    return {key: value for key, location, _, value in entries if location == 0}


def _horizontal_from_keys(keys: dict[int, int]) -> SourceCrs:
    """Read the projected or geographic system; units alone where it is user-defined."""
    stated = _UNITS.get(keys.get(_LINEAR_UNITS, 0))
    if keys.get(_PROJECTED_CRS) in _EPSG_CODES:
        crs = described(pyproj.CRS.from_epsg(keys[_PROJECTED_CRS]))
        if stated is None or is_same_unit(stated, crs.horizontal_unit):
            return crs
        # seen in practice: a code in metres with coordinates in feet; then the code does not fit them
        doubt = f"{crs.name} does not have the unit that the file states ({stated:g} m): assuming unknown"
        return SourceCrs("", stated, stated, doubt=doubt)
    if (
        keys.get(_MODEL_TYPE, _GEOGRAPHIC_MODEL) == _GEOGRAPHIC_MODEL
        and keys.get(_GEODETIC_CRS) in _EPSG_CODES
    ):
        return described(pyproj.CRS.from_epsg(keys[_GEODETIC_CRS]))
    unit = stated or 1.0
    return SourceCrs("", unit, unit)


def _vertical_unit_from_keys(keys: dict[int, int]) -> float | None:
    """Metres per unit of z, None if the keys do not say."""
    stated = _UNITS.get(keys.get(_VERTICAL_UNITS, 0))
    if stated is not None or keys.get(_VERTICAL_CRS) not in _EPSG_CODES:
        return stated
    try:
        axes = pyproj.CRS.from_epsg(keys[_VERTICAL_CRS]).axis_info
    except CRSError:  # codes before EPSG 1024… were ellipsoids (5001…5033): heights without a unit
        return None
    return float(axes[-1].unit_conversion_factor) if axes else None
