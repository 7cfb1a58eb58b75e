"""When each point of a scan was measured, as drivers tell it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import MessageError

#: Names that drivers give to the time of a point: Velodyne and Hesai (`time`, `timestamp`), Ouster (`t`),
#: Livox (`offset_time`, `timestamp`), RoboSense (`timestamp`); the first that is there counts.
TIME_FIELDS = ("t", "time", "timestamp", "offset_time", "time_offset", "timeOffset", "time_stamp")
#: Seconds per unit.
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
#: A time this near to the scan's stamp is a time of day, not one since the scan's beginning [s]. Wide margin:
#: no scan lasts so long, and clocks that are further apart are not those of one machine.
NEAR = 86_400.0
#: The longest that a scan or packet lasts [s].
LONGEST = 2.0
_NANOSECONDS = 1e9
#: Numbers of fewer bytes count the time since 1970 in steps of a minute or more.
_EPOCH_BYTES = 8


def point_times(
    columns: Mapping[str, NDArray[Any]], stamp: int, unit: str = ""
) -> tuple[NDArray[np.int64] | None, str]:
    """
    Return the time of each point of a scan [ns], and the field that told it.

    Times are absolute where they lie within a day of the stamp [ns] in some unit, else they count from the
    stamp. Of several units that are possible, if none of `UNITS` is named, the coarsest counts in which the
    scan takes no longer than 2 s; whole numbers are taken for nanoseconds if that is possible. None if no
    field tells them, or in single precision, which leaves minutes of a time since 1970. MessageError if no
    unit fits, or a time is not finite.
    """
    name = next((name for name in TIME_FIELDS if name in columns), "")
    if not name:
        return None, ""
    values = columns[name]
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        raise MessageError(f"field {name} has times that are not finite")
    if not len(values) or not values.any():
        return None, name
    units = [unit] if unit else list(UNITS)
    absolute = [one for one in units if _is_near(values, UNITS[one], stamp)]
    if absolute and values.dtype.itemsize < _EPOCH_BYTES:
        return None, name
    if absolute:
        return _nanoseconds(values, UNITS[absolute[0]]), name
    relative = [
        one
        for one in units
        if np.abs(values[[values.argmin(), values.argmax()]].astype(float)).max() * UNITS[one] <= LONGEST
    ]
    if not relative:
        raise MessageError(f"field {name} holds times up to {values.max()}: no unit makes them a scan's")
    best = "ns" if values.dtype.kind in "iu" and "ns" in relative else relative[0]
    return stamp + _nanoseconds(values, UNITS[best]), name


def _is_near(values: NDArray[Any], seconds: float, stamp: int) -> bool:
    ends = np.array([values.min(), values.max()], dtype=np.float64) * seconds
    return bool(ends[0] > LONGEST and (np.abs(ends - stamp / _NANOSECONDS) < NEAR).all())


def _nanoseconds(values: NDArray[Any], seconds: float) -> NDArray[np.int64]:
    """Turn times into whole nanoseconds; a float64 of seconds since 1970 keeps a quarter of a microsecond."""
    if values.dtype.kind in "iu":
        return values.astype(np.int64) * round(seconds * _NANOSECONDS)
    return np.rint(values.astype(np.float64) * (seconds * _NANOSECONDS)).astype(np.int64)
