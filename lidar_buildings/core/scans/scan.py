"""A scan's measurements, as its message holds them."""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.bounds import MAX_COORDINATE
from lidar_buildings.core.scans.cloud_layout import Cloud, columns_of, taken_points
from lidar_buildings.core.scans.point_times import TIME_FIELDS, ScanTimes, TimedScan
from lidar_buildings.core.scans.seen_points import SeenPoints
from lidar_buildings.core.scans.transform_tree import frame_name

#: Fields that are kept beside place and time.
KEPT = (
    "intensity",
    "return_number",
    "number_of_returns",
    "classification",
    "scan_angle",
    "scan_direction_flag",
    "point_source_id",
    "gps_time",
    "view",
)
#: Fields of our tiles: which point it is, and whether it is a neighbour's.
_NAMING = ("source", "index")
_OF_TILES = ("buffer", *_NAMING)
#: What is left out of a scan, in words.
NOT_FINITE = "x, y or z is not finite, or beyond any place on Earth"
NO_RETURN = "at the sensor's own place: no return"
NO_TIME = "time is not finite"
OFF_TIME = "time is none of their scan"
#: What is to be said of a scan, in words.
COARSE = "scans whose x or y, far from the origin, are float32: {:g} m apart"
#: Steps of coordinates that are to be told of [m], and points that are looked at for them.
_COARSE_STEP, _N_LOOKED_AT = 0.01, 1_000


class Scan(NamedTuple):
    """A scan in its own frame; its times are its stamp as long as `told` is not understood."""

    frame: str
    points: NDArray[np.float64]  #: [m], shape (n, 3)
    times: NDArray[np.int64]  #: [ns], shape (n,)
    columns: dict[str, NDArray[Any]]  #: our column → values
    doubts: tuple[str, ...] = ()  #: what is to be said of it
    time_field: str = ""  #: the field that tells times, empty if none does
    told: ScanTimes | None = None  #: what it tells


class PlacedScan(NamedTuple):
    """Points of a scan in the map."""

    points: NDArray[np.float64]  #: map frame [m], shape (n, 3)
    times: NDArray[np.int64]  #: [ns], shape (n,)
    columns: dict[str, NDArray[Any]]  #: our column → values
    #: Some places where the scanner was meanwhile, shape (n_places, 3) [m]; none if they are not known.
    way: NDArray[np.float64] = np.empty((0, 3))


def read_scan(message: Any, left_out: Counter[str], seen: SeenPoints | None = None) -> Scan:
    """
    Read a sensor_msgs/PointCloud2, and count what it has beside measurements.

    Of a tile of ours the buffer is left out, and what was `seen` in an earlier sending of it. MessageError if
    its layout contradicts itself, or it has no x, y and z.
    """
    cloud: Cloud = message
    columns = columns_of(cloud, {*TIME_FIELDS, *KEPT, *_OF_TILES})
    xyz = taken_points(columns)
    is_kept = _are_measured(xyz, left_out)
    if "buffer" in columns:  # a tile of ours: these come with another one
        is_kept &= columns.pop("buffer") == 0
        if seen is not None and all(name in columns and columns[name].dtype.kind == "u" for name in _NAMING):
            own = np.flatnonzero(is_kept)
            is_kept[own] = seen.are_new(columns["source"][own], columns["index"][own])
    for name in columns.keys() & set(TIME_FIELDS):
        is_timed = np.isfinite(columns[name])
        _leave_out(left_out, NO_TIME, is_kept & ~is_timed)
        is_kept &= is_timed
    kept = np.flatnonzero(is_kept)
    columns = {name: values[kept] for name, values in columns.items()}
    stamp = stamp_of(message.header)
    points, doubts = xyz[kept], []
    plan = points[:_N_LOOKED_AT, :2]
    single = plan.astype(np.float32)
    step = float(np.spacing(np.abs(single).max(initial=0.0)))
    if step > _COARSE_STEP and np.array_equal(single, plan):
        doubts.append(COARSE.format(step))
    field = next((name for name in TIME_FIELDS if name in columns), "")
    told = ScanTimes(columns[field], stamp) if field else None
    times = np.full(len(kept), stamp, dtype=np.int64)
    frame = frame_name(message.header.frame_id)
    return Scan(frame, points, times, _cleaned(columns), tuple(doubts), field, told)


def timed(one: TimedScan, left_out: Counter[str]) -> Scan:
    """Return a scan with the times of its points, and count those whose time is none of it."""
    scan: Scan = one.scan
    doubts = (*scan.doubts, *filter(None, [one.doubt]))
    if one.is_own.all():
        return scan._replace(times=one.times, doubts=doubts, told=None)
    _leave_out(left_out, OFF_TIME, ~one.is_own)
    columns = {name: values.compress(one.is_own) for name, values in scan.columns.items()}
    points, times = scan.points.compress(one.is_own, axis=0), one.times.compress(one.is_own)
    return Scan(scan.frame, points, times, columns, doubts)


def is_alike(one: Scan, other: Scan) -> bool:
    """Whether two scans can be joined: they are of one frame, and have the same columns."""
    types = [{name: values.dtype for name, values in scan.columns.items()} for scan in (one, other)]
    return one.frame == other.frame and types[0] == types[1]


def joined(scans: Sequence[Scan]) -> Scan:
    """Return scans that are alike as one."""
    first = scans[0]
    if len(scans) == 1:
        return first
    columns = {name: np.concatenate([one.columns[name] for one in scans]) for name in first.columns}
    points, times = (np.concatenate([one[k] for one in scans]) for k in (1, 2))
    return Scan(first.frame, points, times, columns)


def mark_of(message: Any) -> tuple[str, int, int, int]:
    """Return what tells a message from others: its frame, stamp, length and the check sum of its data."""
    data = memoryview(message.data)
    return frame_name(message.header.frame_id), stamp_of(message.header), data.nbytes, zlib.crc32(data)


def stamp_of(header: Any) -> int:
    """Return a header's time [ns]."""
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def _are_measured(xyz: NDArray[np.float64], left_out: Counter[str]) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        is_finite = np.logical_and.reduce([np.abs(one) <= MAX_COORDINATE for one in xyz.T])
        is_return = np.logical_or.reduce([one != 0.0 for one in xyz.T])
    _leave_out(left_out, NOT_FINITE, ~is_finite)
    _leave_out(left_out, NO_RETURN, is_finite & ~is_return)
    return np.logical_and(is_finite, is_return)


def _cleaned(columns: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the columns that are kept; drivers put −1 or NaN where they have no intensity."""
    ours = {name: columns[name] for name in KEPT if name in columns}
    if "gps_time" in ours and not np.isfinite(ours["gps_time"]).all():
        del ours["gps_time"]
    for name, values in ours.items():
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            ours[name] = np.where(np.isfinite(values), values, 0)
    if "intensity" in ours:
        ours["intensity"] = np.maximum(ours["intensity"], 0)
    return ours


def _leave_out(left_out: Counter[str], reason: str, rows: NDArray[np.bool_]) -> None:
    if rows.any():
        left_out[reason] += int(np.count_nonzero(rows))
