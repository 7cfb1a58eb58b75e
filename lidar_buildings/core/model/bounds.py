"""
What can be held: limits of coordinates, columns and lengths, checked where data come in.

Files, messages, bags, footprints and arguments are held to these limits once; behind that, no loop is given a
number that it cannot hold. A point beyond them is left out and counted.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Nothing on or near the Earth has a greater coordinate in any reference system [m].
MAX_COORDINATE = 1e8
#: How far points lie from the map's origin in x and y at most [m]: float32 has steps of 0.1 m there; a survey
#: reaches 16 km.
MAX_DISTANCE = 2.0**20
#: Nothing that lidar measures is so far above or below its datum [m].
MAX_ELEVATION = 1e5
#: How far a message's points lie from its middle in x and y at most [m]: grids over a tile have cells of half
#: a metre and less; the largest tile of a source of ours is 1 km wide.
MAX_REACH = 2.0**12
#: What is said of points beyond.
BEYOND = (
    f"x or y is further than {MAX_DISTANCE / 1000:,.0f} km from the map's origin, or z further than "
    f"{MAX_ELEVATION / 1000:,.0f} km from 0"
)
BEYOND_TILE = f"{BEYOND}, or they lie further than {MAX_REACH / 1000:.0f} km from the middle of the tile"
#: No two neighbouring points are nearer or further apart: the spacing is no shorter or longer than this [m].
SPACINGS = (1e-2, 1e4)
#: Intensities below which ground is dark: of 0 to 255, wide margins.
_DARK_LIMITS = (1e-3, 1e4)
#: No parameter without an upper limit of its own is greater.
MAX_PARAMETER = 1e12
#: A building's id is a uint32, a tile's stamp what a message holds [ns].
MAX_ID, MAX_STAMP = 2**32 - 1, 2**31 * 10**9 - 1
#: What a result may call a length [m].
MAX_LENGTH = 2.0 * MAX_DISTANCE
#: Column → its least and greatest value; wide margins: nothing that a source or stage says is near them.
_COLUMN_LIMITS = {
    "intensity": (-1e9, 1e9),
    "scan_angle": (-1e3, 1e3),
    "gps_time": (-1e12, 1e12),
    "normalised_intensity": (-1e4, 1e4),
    "height_above_ground": (-2.0 * MAX_ELEVATION, 2.0 * MAX_ELEVATION),
    **dict.fromkeys(("linearity", "planarity", "normal_x", "normal_y", "normal_z"), (-1e4, 1e4)),
    "neighbourhood_radius": (0.0, 1e4),
}


def are_held(points: NDArray[Any]) -> NDArray[np.bool_]:
    """Tell which points of the map, shape (n, 2) or (n, 3) [m], are finite and within the limits."""
    held = np.ones(len(points), dtype=np.bool_)
    with np.errstate(invalid="ignore"):
        for column, limit in zip(points.T, (MAX_DISTANCE, MAX_DISTANCE, MAX_ELEVATION), strict=False):
            held &= column <= limit
            held &= column >= -limit
    return held


def are_of_tile(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which points of a message, shape (n, 3) [m], can be held and are near its middle, the median."""
    held = are_held(points)
    where = True if held.all() else held
    ends = [
        (one.min(where=where, initial=np.inf), one.max(where=where, initial=-np.inf)) for one in points.T[:2]
    ]
    if any(high - low > 2.0 * MAX_REACH for low, high in ends):
        plan = points[held, :2]
        held[held] = (np.abs(plan - np.median(plan, axis=0)) <= MAX_REACH).all(axis=1)
    return held


def held_column(name: str, values: NDArray[Any]) -> NDArray[Any]:
    """Return a column with values beyond its limits replaced by these; what is no number stays."""
    limits = _COLUMN_LIMITS.get(name)
    if limits is None or not len(values):
        return values
    low, high = limits
    with np.errstate(invalid="ignore"):
        if low <= values.min() and values.max() <= high:
            return values
    return np.clip(values, low, high)


def checked_id(number: Any) -> int:
    """Return a building's id; ValueError if it cannot be one."""
    if not 0 <= (found := int(number)) <= MAX_ID:
        raise ValueError(f"building id {str(number)[:30]}: must be within 0 to {MAX_ID}")
    return found


def checked_stamp(stamp: Any) -> int:
    """Return a tile's stamp [ns]; ValueError if no message could hold it."""
    if abs(found := int(stamp)) > MAX_STAMP:
        raise ValueError(f"stamp {str(stamp)[:30]}: must be within {MAX_STAMP} ns")
    return found


def checked_spacing(value: Any) -> float:
    """Return a point spacing [m]; ValueError if it is none that points can have."""
    low, high = SPACINGS
    if not low <= value <= high:
        raise ValueError(f"point_spacing = {value!r}: must be a length from {low:g} to {high:g} m")
    return float(value)


def checked_dark_limit(value: Any) -> float:
    """Return the normalised intensity up to which ground is dark; ValueError if it cannot be one."""
    low, high = _DARK_LIMITS
    if not low <= value <= high:
        raise ValueError(f"dark_limit = {value!r}: must be within {low:g} to {high:g}")
    return float(value)


def checked_length(name: str, value: Any) -> float:
    """Return a length [m] that may be negative or not known (NaN); ValueError if it cannot be."""
    length = float(value)
    if not (math.isnan(length) or abs(length) <= MAX_LENGTH):
        raise ValueError(f"{name} = {value!r}: must be within {MAX_LENGTH:,.0f} m")
    return length
