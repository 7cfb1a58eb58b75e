"""Whether clouds can be one survey: each once, one reference system, one map frame that reaches all."""

from __future__ import annotations

import filecmp
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pyproj
import shapely
from pyproj.exceptions import CRSError

from lidar_buildings.core.model.errors import InputError, LidarBuildingsError, ParameterError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.remarks import Remark
from lidar_buildings.io.clouds.cloud import Cloud, CloudExtent
from lidar_buildings.io.clouds.find_inputs import InputFile
from lidar_buildings.io.clouds.las_crs import described, vertical_crs
from lidar_buildings.io.clouds.las_records import read_raw_header
from lidar_buildings.io.files.failures import warn_once
from lidar_buildings.io.files.reference_systems import (
    about_units,
    is_same_unit,
    name_of,
    true_scale,
    with_heights,
)

_Extent = TypeVar("_Extent", bound=CloudExtent)

#: Most files of a survey: a point's `source` is a uint16.
MOST_FILES = 65_535
#: The map's origin is rounded down to this, so that neighbouring surveys share it [m].
ORIGIN_STEP = 100.0
#: So far from the origin float32 has steps of a millimetre (2^-10 m) [m].
REACH = 2.0**14
#: Files that touch have no land so far apart in height between them, however steep it is [m]; they touch if
#: they are no further apart [m].
_STEP, _TOUCHING = 50.0, 1.0
#: The widest survey: its origin lies in its middle [m].
MAX_EXTENT = 2.0 * (REACH - ORIGIN_STEP)


def excess_of(n_files: int) -> str:
    """Say that one run does not take so many files, nothing if it does."""
    if n_files <= MOST_FILES:
        return ""
    return f"{n_files} input files: at most {MOST_FILES} per run: split the survey"


def without_copies(clouds: Sequence[Cloud]) -> list[Cloud]:
    """
    Leave out files that hold the points of one before them, and say so.

    They are told by their headers: as many points, and of each return, in the same bounds to the last digit.
    Points in another order, as of the same file as COPC, are the same; files of one size have to be the same
    byte for byte, as one of them may be damaged.
    """
    seen: dict[tuple[object, ...], Cloud] = {}
    kept: list[Cloud] = []
    copies: list[Cloud] = []
    for cloud in clouds:
        returns = tuple(cloud.header.number_of_points_by_return)
        points = (cloud.point_count, *cloud.mins, *cloud.maxs, *returns, cloud.crs.name)
        first = seen.setdefault(points, cloud)
        is_copy = bool(cloud.point_count) and first is not cloud
        if is_copy and first.path.stat().st_size == cloud.path.stat().st_size:
            # a run's inputs are here by then; of files elsewhere none is read for this
            is_here = all(isinstance(path, Path) for path in (first.path, cloud.path))
            is_copy = is_here and filecmp.cmp(first.path, cloud.path, shallow=False)
        (copies if is_copy else kept).append(cloud)
    if copies:
        warn_once(f"{_named(copies)} with the same points as other inputs: left out")
    return kept


def agreed_system(clouds: Sequence[CloudExtent]) -> CloudExtent:
    """Return the cloud that tells the system of all; InputError if two are in different ones, or units."""
    first = next((cloud for cloud in clouds if cloud.crs.name), clouds[0])
    for cloud in clouds:
        is_like = cloud.crs.name == first.crs.name and np.allclose(first.units, cloud.units, rtol=1e-7)
        if cloud.point_count and not (is_like or _is_silent(cloud, first)):
            raise InputError(
                f"{cloud.path}: is in {_system(cloud)}, but {first.path} in {_system(first)}: "
                "transform them to one system, or run them separately"
            )
    return first


def given_system(crs: str, first: CloudExtent) -> str:
    """
    Return the name of a system that a user gives clouds which name none; `first` tells for all of them.

    ParameterError if it is none in which their coordinates can be, InputError if they name another one.
    """
    try:
        given = described(pyproj.CRS.from_user_input(crs))
    except (CRSError, ValueError) as error:
        raise ParameterError(
            f"crs = {crs[:100]!r}: is not a reference system: give one such as EPSG:28992"
        ) from error
    if first.crs.name not in ("", given.name):
        raise InputError(f"{first.path}: is in {_system(first)}: remove the crs {crs}")
    if not given.is_projected or not is_same_unit(given.horizontal_unit, first.crs.horizontal_unit):
        unit = f"{first.crs.horizontal_unit:.7g} m"
        raise ParameterError(f"crs = {crs!r}: must be projected, with the unit of the inputs, {unit}")
    return given.name


def in_true_units(clouds: Sequence[_Extent], crs: str) -> list[_Extent]:
    """
    Return clouds of one system with the true length of its unit, where the projection is not true to scale.

    `crs` names the system. The scale is that in the middle of all.
    """
    filled = [cloud for cloud in clouds if cloud.point_count]
    if not filled or not crs:
        return list(clouds)
    lows, highs = (np.array([getattr(one, name)[:2] for one in filled]) for name in ("mins", "maxs"))
    middle = (lows.min(axis=0) + highs.max(axis=0)) / 2.0
    if (scale := true_scale(crs, middle)) == 1.0:
        return list(clouds)
    stated = filled[0].crs.horizontal_unit
    return [replace(one, crs=replace(one.crs, horizontal_unit=stated * scale)) for one in clouds]


def in_frame(clouds: Sequence[_Extent], frame: MapFrame) -> list[_Extent]:
    """Return clouds with the units of their survey's frame, and remarks on their heights."""
    return with_heights_compared([cloud.in_frame(frame) for cloud in clouds])


def with_heights_compared(clouds: Sequence[_Extent]) -> list[_Extent]:
    """Return clouds with a remark to those whose heights lie apart from those of most that they touch."""
    scaled = list(clouds)
    filled = np.array([k for k, cloud in enumerate(scaled) if cloud.point_count], dtype=np.intp)
    if len(filled) < 2:
        return scaled
    lows, highs = (
        np.array([getattr(scaled[k], end) * scaled[k].units for k in filled]) for end in ("mins", "maxs")
    )
    boxes = shapely.box(*lows[:, :2].T, *highs[:, :2].T)
    one, other = shapely.STRtree(boxes).query(boxes, predicate="dwithin", distance=_TOUCHING)
    one, other = one[one != other], other[one != other]
    step = np.maximum(lows[one, 2] - highs[other, 2], lows[other, 2] - highs[one, 2])
    n_beside, n_apart = (np.bincount(own, minlength=len(filled)) for own in (one, one[step > _STEP]))
    for row in np.flatnonzero(2 * n_apart > n_beside):
        cloud = scaled[filled[row]]
        text = (
            f"{cloud.path}: its heights, {lows[row, 2]:,.0f} to {highs[row, 2]:,.0f} m, lie "
            f"{step[one == row].max():,.0f} m apart from those of files that touch it: another unit or level?"
        )
        scaled[filled[row]] = replace(cloud, remarks=(*cloud.remarks, Remark("heights_apart", text)))
    return scaled


def about_system(clouds: Sequence[CloudExtent]) -> list[Remark]:
    """Say what of the units of clouds of `in_true_units` is not as usual."""
    areas = [(cloud.mins[:2], cloud.maxs[:2]) for cloud in clouds if cloud.point_count]
    if not areas:
        return []
    lows, highs = map(np.array, zip(*areas, strict=True))
    crs = clouds[0].crs
    bounds = np.stack([lows.min(axis=0), highs.max(axis=0)]) * crs.horizontal_unit
    frame = MapFrame(crs.name, (0.0, 0.0, 0.0), crs.horizontal_unit, crs.vertical_unit)
    return about_units(frame, bounds)


def shared_origin(clouds: Sequence[CloudExtent]) -> tuple[float, float]:
    """
    Return x and y of the map's origin [m]: the lower corner of all clouds, of a wide survey its middle.

    InputError if float32 cannot hold all coordinates to a millimetre from there, naming the clouds furthest
    apart.
    """
    filled = [cloud for cloud in clouds if cloud.point_count]
    if not filled:
        return 0.0, 0.0
    lows = np.array([(cloud.mins * cloud.units)[:2] for cloud in filled])
    highs = np.array([(cloud.maxs * cloud.units)[:2] for cloud in filled])
    corner, extent = lows.min(axis=0), highs.max(axis=0) - lows.min(axis=0)
    axis = int(extent.argmax())
    if extent[axis] > MAX_EXTENT:
        one, other = filled[int(lows[:, axis].argmin())].path, filled[int(highs[:, axis].argmax())].path
        reach = f"{extent[axis] / 1000:.1f} km, more than the {MAX_EXTENT / 1000:.1f} km of one run"
        raise InputError(f"{one} and {other}: together they span {reach}: run them separately")
    if extent[axis] > REACH - ORIGIN_STEP:
        corner = corner + extent / 2
    x, y = np.floor(corner / ORIGIN_STEP) * ORIGIN_STEP
    return float(x), float(y)


def crs_with_heights(inputs: Sequence[InputFile], frame: MapFrame) -> str:
    """Return the frame's reference system, with the vertical one if all files that state one agree."""
    stated: dict[str, Any] = {}
    for file in inputs:
        with suppress(LidarBuildingsError, OSError):
            raw = read_raw_header(file.path)
            if (crs := vertical_crs(raw.vlrs + raw.evlrs)) is not None:
                stated[crs.to_wkt()] = crs
    if not frame.crs or len(stated) != 1:
        return frame.crs
    (vertical,) = stated.values()
    if not is_same_unit(vertical.axis_info[0].unit_conversion_factor, frame.vertical_unit):
        return frame.crs
    return with_heights(frame.crs, vertical)


def say_what_is_assumed(clouds: Sequence[Cloud], first: CloudExtent) -> None:
    """Warn of clouds that take their reference system from another one, and of different vertical systems."""
    silent = [cloud for cloud in clouds if cloud.point_count and _is_silent(cloud, first)]
    if silent:
        system = f"{_system(first)} as {first.path}"
        warn_once(f"{_named(silent)} without reference system: assuming {system}")
    heights: dict[str, list[Cloud]] = {}
    for cloud in clouds if len(clouds) > 1 else ():
        if cloud.point_count:
            system = vertical_crs(cloud.raw.vlrs + cloud.raw.evlrs)
            heights.setdefault(name_of(system) if system else "", []).append(cloud)
    silent = heights.pop("", [])
    if len(heights) > 1:
        told = ", ".join(f"{name[:40]} in {_named(group)}" for name, group in heights.items())
        warn_once(f"heights are in different systems ({told}): used unchanged, and the outputs name none")
    elif heights and silent:
        name = next(iter(heights))
        warn_once(f"{_named(silent)} without vertical reference system: assuming heights in {name}")


def _is_silent(cloud: CloudExtent, first: CloudExtent) -> bool:
    return bool(first.crs.name and not cloud.crs.name and np.allclose(first.units, cloud.units))


def _named(clouds: Sequence[Cloud]) -> str:
    more = f" and {len(clouds) - 1} more" if len(clouds) > 1 else ""
    return f"{clouds[0].path}{more}"


def _system(cloud: CloudExtent) -> str:
    name = cloud.crs.name.split(",")[0] if cloud.crs.name else "an unknown reference system"
    return f"{name} with units of {cloud.crs.horizontal_unit:.7g} m and {cloud.crs.vertical_unit:.7g} m"
