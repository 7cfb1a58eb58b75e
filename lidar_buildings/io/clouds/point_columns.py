"""From a LAS file's dimensions to the columns of a tile."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import laspy
import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.bounds import held_column
from lidar_buildings.core.model.classes import PointClass, View
from lidar_buildings.core.neighbours.cell_grid import cell_numbers
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.core.neighbours.strip_views import with_covered

#: Degrees per step of the scan angle in point formats 6 to 10 (LAS 1.4).
SCAN_ANGLE_STEP = 0.006
#: Extra dimension with from where a point was seen, `lidar_buildings.core.model.classes.View`.
VIEW = "View"
#: Side of the cells in which places are counted [m].
_PLACE = 4.0
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
        "view": _views(chunk),
    }


def _views(chunk: laspy.ScaleAwarePointRecord) -> NDArray[np.uint8]:
    """Return from where points were seen; one of those that other software calls so is not ours."""
    own = chunk.array.dtype.fields.get(VIEW)
    if own is None or own[0] != np.uint8:
        return np.zeros(len(chunk), dtype=np.uint8)
    view = np.minimum(chunk.array[VIEW], View.STREET)
    return np.asarray(view, dtype=np.uint8)


def without_empty_columns(columns: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any] | None]:
    """
    Put None for columns that say nothing.

    Return numbers count from 1: a file in which all are 0 does not know them. The same holds for GPS times
    that are all 0, and for views that nothing tells; times are of use only where every point has one.
    """
    kept: dict[str, NDArray[Any] | None] = dict(columns)
    if not columns["return_number"].any() or not columns["number_of_returns"].any():
        kept["return_number"] = kept["number_of_returns"] = None
    if np.isnan(columns["gps_time"]).any() or not columns["gps_time"].any():
        kept["gps_time"] = None
    if not columns["view"].any():
        kept["view"] = None
    return kept


def last_returns(
    points: NDArray[np.float64],
    return_number: NDArray[np.uint8] | None,
    number_of_returns: NDArray[np.uint8] | None,
) -> NDArray[np.float64]:
    """Return one point per pulse: its last return; every point where returns are not known (None, all 0)."""
    is_last = _are_last(return_number, number_of_returns)
    return points if is_last is None else points.compress(is_last, axis=0)


def _are_last(
    return_number: NDArray[np.uint8] | None, number_of_returns: NDArray[np.uint8] | None
) -> NDArray[np.bool_] | None:
    if return_number is None or number_of_returns is None or not return_number.any():
        return None
    is_last = np.asarray(return_number >= number_of_returns)
    return is_last if is_last.any() else None


def views_of_tile(
    points: NDArray[np.float64], columns: Mapping[str, NDArray[Any] | None], spacing: float | None
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """
    Return the views of a tile's points, and the pulses by which its spacing is measured.

    The column `view` tells from where each was seen; what was seen from the street is `COVERED` where a place
    was seen from above. Pulses are those from above, unless most of the area was seen from the street alone.
    `spacing` is that of pulses from above, measured if it is not known [m].
    """
    view, number, of = (columns[name] for name in ("view", "return_number", "number_of_returns"))
    is_last = _are_last(number, of)
    pulses = np.ones(len(points), dtype=bool) if is_last is None else is_last
    is_above = np.asarray(view < View.STREET)
    if spacing is None:
        spacing = measure_spacing(points.compress(pulses & is_above, axis=0))
    view = with_covered(points, np.asarray(view), spacing)
    is_alone = view == View.STREET
    n_alone, n_above = (
        len(np.unique(cell_numbers(points.compress(rows, axis=0), _PLACE))) if rows.any() else 0
        for rows in (is_alone, is_above)
    )
    return view, pulses & (is_alone if n_alone > n_above else is_above)


def xyz_of(chunk: laspy.ScaleAwarePointRecord) -> NDArray[np.float64]:
    """Return a chunk's coordinates, shape (n, 3), in the source's own system."""
    counts = np.stack([chunk.array[name] for name in "XYZ"]).T  # column by column: numpy is slow in threes
    return counts * chunk.scales + chunk.offsets
