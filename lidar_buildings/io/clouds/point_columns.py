"""From a LAS file's dimensions to the columns of a tile."""

from __future__ import annotations

from typing import Any

import laspy
import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.bounds import held_column
from lidar_buildings.core.model.classes import PointClass

#: Degrees per step of the scan angle in point formats 6 to 10 (LAS 1.4).
SCAN_ANGLE_STEP = 0.006
#: The first point format with 4-bit return numbers, 8-bit classes and fine scan angles.
FIRST_EXTENDED_FORMAT = 6


def point_columns(chunk: laspy.ScaleAwarePointRecord) -> dict[str, NDArray[Any]]:
    """Return columns as a tile names them, `gps_time` NaN where there is none; withheld points are noise."""
    if chunk.point_format.id >= FIRST_EXTENDED_FORMAT:
        scan_angle = chunk.array["scan_angle"] * np.float32(SCAN_ANGLE_STEP)
    else:
        scan_angle = chunk.array["scan_angle_rank"].astype(np.float32)
    has_time = "gps_time" in chunk.array.dtype.names
    withheld, classes = np.asarray(chunk.withheld, dtype=bool), np.asarray(chunk.classification)
    return {
        "intensity": chunk.array["intensity"].astype(np.float32),
        "return_number": np.asarray(chunk.return_number, dtype=np.uint8),
        "number_of_returns": np.asarray(chunk.number_of_returns, dtype=np.uint8),
        "classification": np.where(withheld, PointClass.LOW_NOISE, classes).astype(np.uint8),
        "scan_angle": scan_angle,
        "scan_direction_flag": np.asarray(chunk.scan_direction_flag, dtype=np.uint8),
        "point_source_id": chunk.array["point_source_id"],
        "gps_time": held_column("gps_time", chunk.array["gps_time"])
        if has_time
        else np.full(len(chunk), np.nan),
    }


def without_empty_columns(columns: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any] | None]:
    """
    Put None for columns that say nothing.

    Return numbers count from 1: a file in which all are 0 does not know them. The same holds for GPS times
    that are all 0; and times are of use only where every point has one.
    """
    kept: dict[str, NDArray[Any] | None] = dict(columns)
    if not columns["return_number"].any() or not columns["number_of_returns"].any():
        kept["return_number"] = kept["number_of_returns"] = None
    if np.isnan(columns["gps_time"]).any() or not columns["gps_time"].any():
        kept["gps_time"] = None
    return kept


def last_returns(
    points: NDArray[np.float64],
    return_number: NDArray[np.uint8] | None,
    number_of_returns: NDArray[np.uint8] | None,
) -> NDArray[np.float64]:
    """Return one point per pulse: its last return; every point where returns are not known (None, all 0)."""
    if return_number is None or number_of_returns is None or not return_number.any():
        return points
    is_last = return_number >= number_of_returns
    return points.compress(is_last, axis=0) if is_last.any() else points


def xyz_of(chunk: laspy.ScaleAwarePointRecord) -> NDArray[np.float64]:
    """Return a chunk's coordinates, shape (n, 3), in the source's own system."""
    counts = np.stack([chunk.array[name] for name in "XYZ"]).T  # column by column: numpy is slow in threes
    return counts * chunk.scales + chunk.offsets
