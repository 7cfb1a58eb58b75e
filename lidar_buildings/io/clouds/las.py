"""
LAS, LAZ and COPC files: opened, checked and read in chunks by laspy with its lazrs backend.

Any failure is one `InputError` of the form "file: what is wrong: what to do".
"""

from __future__ import annotations

import copy
import os
import struct
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.bounds import BEYOND, are_held
from lidar_buildings.core.model.classes import View
from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.point_spacing import steady_spacing
from lidar_buildings.core.neighbours.strip_views import strip_numbers, strip_views
from lidar_buildings.io.clouds import agreement
from lidar_buildings.io.clouds.agreement import MAX_EXTENT, REACH
from lidar_buildings.io.clouds.cloud import Cloud, CloudExtent
from lidar_buildings.io.clouds.copc import runs_touching
from lidar_buildings.io.clouds.find_inputs import Inputs, open_each
from lidar_buildings.io.clouds.las_crs import metric_crs, source_crs
from lidar_buildings.io.clouds.las_records import read_raw_header
from lidar_buildings.io.clouds.point_columns import (
    last_returns,
    point_columns,
    views_of_tile,
    without_empty_columns,
    xyz_of,
)
from lidar_buildings.io.files.failures import captured_panics, reported, warn_once
from lidar_buildings.io.files.locations import located, open_binary, state_of

#: Points that may lie this far outside their header's bounds before these are measured anew [m];
#: wide margin: headers round to millimetres, wrong ones are kilometres off.
_BOUNDS_TOLERANCE = 1.0
#: Points decoded when a file is opened; wide margin: one shows whether decoding works.
_PROBE = 100
#: No survey has coarser steps or lies further from the origin of its coordinates, in whatever unit.
_MAX_SCALE, _MAX_OFFSET = 1e3, 1e12
#: An index is a uint32.
MOST_POINTS = 2**32 - 1


def open_cloud(path: str | Path) -> Cloud:
    """Open and check a file: header, records, first points; InputError in one line if it is wrong."""
    path = located(path)
    with reported(path):
        state = state_of(path)
        raw = read_raw_header(path)
        with (
            captured_panics(),
            laspy.open(open_binary(path), laz_backend=laspy.LazBackend.Lazrs, read_evlrs=False) as reader,
        ):
            header = copy.deepcopy(reader.header)
            first = reader.read_points(_PROBE)
        scales, offsets = np.asarray(header.scales), np.asarray(header.offsets)
        is_scale = (np.abs(scales) <= _MAX_SCALE) & (scales != 0)
        if not (is_scale.all() and (np.abs(offsets) <= _MAX_OFFSET).all()):
            raise InputError(
                f"{path}: its header is damaged (coordinate scales {scales.tolist()}, offsets "
                f"{offsets.tolist()}): export it again"
            )
        n_points = header.point_count
        if n_points > MOST_POINTS:
            raise InputError(f"{path}: contains {n_points} points, more than {MOST_POINTS}: split it")
        place = np.median(xyz_of(first)[:, :2], axis=0) if n_points else None
        prefers_wkt = bool(header.global_encoding.wkt)
        crs, remarks = source_crs(raw.vlrs + raw.evlrs, prefer_wkt=prefers_wkt, label=str(path), place=place)
        cloud = Cloud(path, raw, crs, np.full(3, np.nan), np.full(3, np.nan), state, header, remarks=remarks)
        if not cloud.point_count:
            warn_once(f"{path}: contains no points: export it again unless this is intended")
            return cloud
        mins, maxs = _bounds(cloud, xyz_of(first))
        crs = metric_crs(path, crs, cloud.point_count, mins, maxs)
        return replace(cloud, crs=crs, mins=mins, maxs=maxs)


def open_inputs(inputs: Inputs) -> tuple[list[Cloud], list[str]]:
    """
    Open files, folders and globs, copies once; what is unreadable does not keep the others from it.

    A point's `source` is its file's place in the list returned; beside it one line for each other file.
    InputError if none can be read.
    """
    clouds, problems = open_each(inputs, open_cloud)
    return agreement.without_copies(clouds), problems


def read(*paths: str | os.PathLike[str], bounds: Sequence[float] | None = None, crs: str = "") -> PointTile:
    """
    Read LAS, LAZ or COPC files, folders, globs or URLs as one tile, or a part of them.

    `bounds` are west, south, east and north of the points that are wanted, in the files' own coordinates; of
    COPC only the chunks that touch them are read. `crs` is the system of files that name none. Rows are in
    the order of files and points; the map's origin is the files' lower corner rounded down to 100 m, and
    `world` has the files' own coordinates. InputError if a file cannot be read, or they do not fit together.
    """
    clouds, problems = open_inputs(paths)
    if problems:
        raise InputError(*problems)
    frame = frame_of(clouds, crs)
    clouds = agreement.in_frame(clouds, frame)
    within = (-np.inf, -np.inf, np.inf, np.inf) if bounds is None else bounds
    parts = [
        {
            "source": np.full(len(rows), number, np.uint16),
            "index": rows,
            "points": frame.to_map(xyz_of(chunk)),
            **point_columns(chunk),
        }
        for number, cloud in enumerate(clouds)
        for rows, chunk in chunks_within(cloud, within)
    ]
    for part in parts:
        if not (held := are_held(part["points"])).all():
            path = clouds[part["source"][0]].path
            warn_once(f"{path}: {np.count_nonzero(~held):,} points are left out: {BEYOND}")
            part.update({name: column[held] for name, column in part.items()})
    if not parts:
        return PointTile(np.empty((0, 3)), frame=frame)
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    tile = PointTile(columns.pop("points"), frame=frame)
    numbers = {name: columns.pop(name) for name in ("source", "index")}
    view = strip_views(tile.points, strip_numbers(columns["point_source_id"], columns["gps_time"], len(tile)))
    columns["view"] = np.where(columns["view"] == View.UNKNOWN, view, columns["view"])
    if not (columns["view"] >= View.STREET).any():
        columns["view"][:] = View.UNKNOWN
    kept = without_empty_columns(columns)
    last = last_returns(tile.points, kept["return_number"], kept["number_of_returns"])
    if kept["view"] is not None:
        kept["view"], is_measured = views_of_tile(tile.points, columns, None)
        last = tile.points.compress(is_measured, axis=0)
    spacing = steady_spacing(last, None)
    return tile.with_columns(**kept, **numbers, point_spacing=spacing)


def read_tile(path: str | os.PathLike[str], bounds: Sequence[float] | None = None) -> PointTile:
    """Read one file, as `read` does."""
    return read(path, bounds=bounds)


def chunks_within(
    cloud: Cloud, bounds: Sequence[float]
) -> Iterator[tuple[NDArray[np.int64], laspy.ScaleAwarePointRecord]]:
    """Yield places in the file and points in or on bounds (W, S, E, N), or InputError if it is unreadable."""
    low, high = np.array(bounds, dtype=np.float64).reshape(2, 2)
    for first, chunk in cloud.runs(runs_touching(cloud, bounds)):
        places = xyz_of(chunk)[:, :2]
        rows = np.flatnonzero(((places >= low) & (places <= high)).all(axis=1))
        if len(rows):
            yield first + rows, chunk[rows]


def frame_of(clouds: list[Cloud], crs: str = "") -> MapFrame:
    """Return the frame of clouds; InputError if they differ in system or unit, or lie too far apart."""
    first = agreement.agreed_system(clouds)
    agreement.say_what_is_assumed(clouds, first)
    name = agreement.given_system(crs, first) if crs else first.crs.name
    scaled = agreement.in_true_units(clouds, name)
    x, y = agreement.shared_origin(scaled)
    return MapFrame(name, (x, y, 0.0), scaled[0].crs.horizontal_unit, first.crs.vertical_unit)


def _bounds(cloud: Cloud, first: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the header's bounds, or measured ones if these cannot be, or are wrong by the first points."""
    mins, maxs = np.array(cloud.header.mins, dtype=float), np.array(cloud.header.maxs, dtype=float)
    slack = _BOUNDS_TOLERANCE / cloud.units
    reach = 2.0**31 * np.abs(cloud.header.scales) + slack  # coordinates are steps in 32 bits
    can_be = np.abs(np.array([mins, maxs]) - cloud.header.offsets) <= reach
    can_be[:, :2] &= ((maxs - mins) * cloud.units)[:2] <= MAX_EXTENT
    if can_be.all() and ((first >= mins - slack) & (first <= maxs + slack)).all():
        return mins, maxs
    mins, maxs = _extremes(cloud, np.full(3, np.nan), np.inf)
    _check_not_clamped(cloud, mins, maxs)
    warn_once(f"{cloud.path}: the bounds in its header do not match its points: recomputed")
    if ((maxs - mins) * cloud.units)[:2].max() <= MAX_EXTENT:
        return mins, maxs
    middle = np.median([np.median(xyz_of(chunk), axis=0) for chunk in cloud.chunks()], axis=0)
    warn_once(f"{cloud.path}: has points more than {REACH / 1000:.0f} km from most: coarse coordinates")
    return _extremes(cloud, middle, REACH / 2)


def _check_not_clamped(cloud: Cloud, mins: NDArray[np.float64], maxs: NDArray[np.float64]) -> None:
    """Refuse a file of which one coordinate is the limit of the file's integers at all points."""
    limits = np.array([-(2.0**31), 2.0**31 - 1.0])[:, None] * cloud.header.scales + cloud.header.offsets
    is_limit = (np.abs(limits - mins) <= np.abs(cloud.header.scales)).any(axis=0)
    clamped = [name for name, one in zip("xyz", is_limit & (mins == maxs), strict=True) if one]
    if clamped and cloud.point_count > 1:
        raise InputError(
            f"{cloud.path}: {' and '.join(clamped)} is the same at all points, the limit of the file's "
            "integers: it was written with a wrong offset; export it again"
        )


def _extremes(
    cloud: Cloud, middle: NDArray[np.float64], reach: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the bounds of the points that lie no further from a place in x or y than the reach [m]."""
    found = []
    for xyz in map(xyz_of, cloud.chunks()):
        far = (np.abs(xyz - middle) * cloud.units)[:, :2].max(axis=1) > reach
        if not far.all():
            found.append((xyz[~far].min(axis=0), xyz[~far].max(axis=0)))
    return np.min([low for low, _ in found], axis=0), np.max([high for _, high in found], axis=0)


#: Where the header has greatest and least x, y and z, in turns (LAS 1.4, table 3).
_BOUNDS, _BOUNDS_AT = struct.Struct("<6d"), 179


def read_extent(path: Path) -> CloudExtent:
    """Read a file's header; InputError if it is no LAS file, or its header cannot be true."""
    with reported(path):
        raw = read_raw_header(path)
        prefers_wkt = raw.minor_version >= 4 and bool(raw.global_encoding & 0x10)
        bounds = np.array(_BOUNDS.unpack_from(raw.block, _BOUNDS_AT)).reshape(3, 2)
        maxs, mins = bounds.T if raw.point_count else np.full((2, 3), np.nan)
        place = (mins + maxs)[:2] / 2.0 if raw.point_count else None
        crs, remarks = source_crs(raw.vlrs + raw.evlrs, prefer_wkt=prefers_wkt, label=str(path), place=place)
        if raw.point_count:
            crs = metric_crs(path, crs, raw.point_count, mins, maxs)
        width = (maxs - mins)[:2] * crs.horizontal_unit
        if raw.point_count and not ((width >= 0.0) & (width <= MAX_EXTENT)).all():
            raise InputError(
                f"{path}: the bounds in its header are impossible: export it again (a run recomputes them)"
            )
        return CloudExtent(path, raw, crs, mins, maxs, state_of(path), remarks=remarks)
