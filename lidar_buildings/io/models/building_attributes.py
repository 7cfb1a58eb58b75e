"""The attributes of a building as files carry them: their types, and their values in the source's units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.solids.face_shape import face_plane, face_shape

#: Column with the name that stays the same in every file, made from the anchor's coordinates.
READABLE_ID = "readable_id"
#: Name → type of every attribute of DESIGN.md section 3, in the order of the columns.
BUILDING_FIELDS: dict[str, type] = {
    "building_id": int,
    "footprint_id": str,
    "status": str,
    "reason": str,
    "ground_elevation": float,
    "roof_elevation_min": float,
    "roof_elevation_50p": float,
    "roof_elevation_70p": float,
    "roof_elevation_max": float,
    "height": float,
    "area": float,
    "n_points": int,
    "point_spacing": float,
    "outline_sigma": float,
    "outline_max_offset": float,
    "n_planes": int,
    "roof_type": str,
    "rmse": float,
    "plane_sigma": float,
    "coverage": float,
    "no_data_share": float,
    "volume": float,
    "lod": str,
    "validity": str,
}
_PLANE = ("plane_a", "plane_b", "plane_c")
#: Name → type of what is said of each face of a roof.
FACE_FIELDS: dict[str, type] = {
    "slope_deg": float,
    "azimuth_deg": float,
    "area": float,
} | dict.fromkeys(_PLANE, float)
_ELEVATIONS = {name for name in BUILDING_FIELDS if "_elevation" in name}
_HEIGHTS = {"height", "rmse", "plane_sigma"}
_LENGTHS = {"point_spacing", "outline_sigma", "outline_max_offset"}
#: Decimals that are written: a tenth of a millimetre or finer, and no noise of the last bit.
_DECIMALS = 4
#: Of slopes [m/m], which are multiplied by coordinates of 10⁷ m.
_DECIMALS_OF_SLOPES = 12


def in_source_units(attributes: dict[str, Any], frame: MapFrame) -> dict[str, Any]:
    """
    Return a building's attributes with lengths and elevations as the source measures them.

    Numbers that are not finite become None.
    """
    return {name: _converted(name, value, frame) for name, value in attributes.items()}


def face_attributes(rings: Sequence[NDArray[np.float64]], frame: MapFrame) -> dict[str, Any]:
    """
    Return what the geometry of a roof's face tells, by the names of `FACE_FIELDS`.

    In the source's coordinates and units the face's plane is z = plane_a x + plane_b y + plane_c.
    """
    return in_source_units(face_shape(rings)._asdict(), frame) | _plane(rings, frame)


def _plane(rings: Sequence[NDArray[np.float64]], frame: MapFrame) -> dict[str, Any]:
    """Return the equation of a face's plane in the source's coordinates; None where it does not look up."""
    equation = face_plane(rings)
    if equation is None:
        return dict.fromkeys(_PLANE)
    steepness = frame.horizontal_unit / frame.vertical_unit
    a, b = (round(one * steepness, _DECIMALS_OF_SLOPES) + 0.0 for one in equation[:2])  # no minus zero
    x, y, z = frame.to_source(np.array([[0.0, 0.0, equation[2]]]))[0].tolist()
    return dict(zip(_PLANE, (a, b, round(z - a * x - b * y, _DECIMALS)), strict=True))


def _converted(name: str, value: Any, frame: MapFrame) -> Any:
    value = value.item() if hasattr(value, "item") else value
    if not isinstance(value, float):
        return value
    if not math.isfinite(value):
        return None
    if name in _ELEVATIONS:
        value = (value + frame.origin[2]) / frame.vertical_unit
    elif name in _HEIGHTS:
        value /= frame.vertical_unit
    elif name in _LENGTHS:
        value /= frame.horizontal_unit
    elif name == "area":
        value /= frame.horizontal_unit**2
    elif name == "volume":
        value /= frame.horizontal_unit**2 * frame.vertical_unit
    return round(value, _DECIMALS)
