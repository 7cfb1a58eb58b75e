"""A building of a survey and a piece of its terrain, as the formats of city models are given them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.roof_lines import RoofLine, roof_lines
from lidar_buildings.core.solids.shell import (
    GROUND_SURFACE,
    OUTER_CEILING_SURFACE,
    ROOF_SURFACE,
    WALL_SURFACE,
    Solid,
    face_plane,
    face_shape,
)
from lidar_buildings.core.solids.triangulation import face_pieces

if TYPE_CHECKING:
    from lidar_buildings.io.models.tiles3d import EarthFrame

#: Surface → its material's name and colour (sRGB, 0 to 1).
MATERIALS = {
    ROOF_SURFACE: ("roof", (0.72, 0.29, 0.22)),
    WALL_SURFACE: ("wall", (0.85, 0.82, 0.76)),
    GROUND_SURFACE: ("ground", (0.45, 0.45, 0.42)),
    OUTER_CEILING_SURFACE: ("soffit", (0.62, 0.55, 0.48)),
}
TERRAIN = ("terrain", (0.47, 0.53, 0.38))


#: Column with the name that stays the same in every file, made from the anchor's coordinates.
READABLE_ID = "readable_id"
#: Name → type of every attribute of a building (doc/formats.md), in the order of the columns.
BUILDING_FIELDS: dict[str, type] = {
    "building_id": int, "footprint_id": str, "status": str, "reason": str, "quality": str,
    "quality_reasons": str, "ground_elevation": float, "ground_elevation_min": float,
    "ground_elevation_max": float, "roof_elevation_min": float, "roof_elevation_50p": float,
    "roof_elevation_70p": float, "roof_elevation_max": float, "height": float,
    "area": float, "n_points": int, "point_spacing": float, "outline_sigma": float,
    "outline_max_offset": float, "n_planes": int, "roof_type": str, "conditions": str, "rmse": float,
    "plane_sigma": float, "corner_sigma_xy": float, "corner_sigma_z": float, "coverage": float,
    "no_data_share": float, "volume": float, "lod": str, "validity": str,
}  # fmt: skip
_PLANE = ("plane_a", "plane_b", "plane_c")
#: Name → type of what is said of each face of a roof.
FACE_FIELDS: dict[str, type] = {
    "slope_deg": float,
    "azimuth_deg": float,
    "area": float,
} | dict.fromkeys((*_PLANE, "elevation_sigma"), float)
_ELEVATIONS = {name for name in BUILDING_FIELDS if "_elevation" in name}
_LENGTHS = {"height", "rmse", "plane_sigma", "point_spacing", "outline_sigma", "outline_max_offset"}
_LENGTHS |= {"corner_sigma_xy", "corner_sigma_z", "elevation_sigma", "position_sigma"}
#: Decimals that are written: a tenth of a millimetre or finer, and no noise of the last bit.
_DECIMALS = 4
#: Of slopes [m/m], which are multiplied by coordinates of 10⁷ m.
_DECIMALS_OF_SLOPES = 12


def in_source_units(attributes: dict[str, Any], frame: MapFrame) -> dict[str, Any]:
    """Return attributes in the unit of a `model_frame`, which is `frame`; None for numbers not finite."""
    return {name: _converted(name, value, frame) for name, value in attributes.items()}


def told_in_units(told: dict[str, Any], frame: MapFrame) -> dict[str, Any]:
    """Return what `told_precision` and the street tell of a face, in the source's units."""
    written, units = in_source_units(told, frame), frame.units.tolist()
    if "corner_sigmas" in told:
        written["corner_sigmas"] = [
            [[_in_unit(one, unit) for one, unit in zip(own, units, strict=True)] for own in ring]
            for ring in told["corner_sigmas"]
        ]
    return written


def _in_unit(length: float | None, unit: float) -> float | None:
    return None if length is None else round(length / unit, _DECIMALS)


def face_attributes(rings: Sequence[NDArray[np.float64]], frame: MapFrame) -> dict[str, Any]:
    """
    Return what the geometry of a roof's face tells, by the names of `FACE_FIELDS`, in a `model_frame`.

    In the source's coordinates and units the face's plane is z = plane_a x + plane_b y + plane_c.
    """
    told, equation = in_source_units(face_shape(rings)._asdict(), frame), face_plane(rings)
    if equation is None:
        return told | dict.fromkeys(_PLANE)  # it does not look up
    steepness = frame.horizontal_unit / frame.vertical_unit
    a, b = (round(one * steepness, _DECIMALS_OF_SLOPES) + 0.0 for one in equation[:2])  # no minus zero
    x, y, z = frame.to_source(np.array([[0.0, 0.0, equation[2]]]))[0].tolist()
    return told | dict(zip(_PLANE, (a, b, round(z - a * x - b * y, _DECIMALS)), strict=True))


def _converted(name: str, value: Any, frame: MapFrame) -> Any:
    value = value.item() if hasattr(value, "item") else value
    if not isinstance(value, float):
        return value
    if not math.isfinite(value):
        return None
    if name in _ELEVATIONS:
        value = (value + frame.origin[2]) / frame.vertical_unit
    elif name in _LENGTHS:
        value /= frame.vertical_unit
    elif name == "area":
        value /= frame.vertical_unit**2
    elif name == "volume":
        value /= frame.vertical_unit**3
    return round(value, _DECIMALS)


@dataclass(frozen=True, eq=False)
class SurveyBuilding:
    """One building, as far as the run went."""

    building_id: int  #: see `lidar_buildings.core.model.ids`
    readable_id: str  #: the name that files carry, made from the anchor's coordinates
    #: Before and after regularisation, map frame [m].
    traced: Outline | None
    outline: Outline | None
    line: str  #: the CityJSONFeature, empty if there is none
    attributes: dict[str, Any]  #: in the source's units
    #: The finest solid and its level of detail, empty and None if there is none; map frame [m].
    lod: str = ""
    solid: Solid | None = None
    #: The attributes of each of its roof faces, in the source's units.
    roof_faces: tuple[dict[str, Any], ...] = ()

    @cached_property
    def pieces(self) -> list[list[tuple[int, ...]]]:
        """The convex pieces of three or four corners of each face of the solid, as rows of its vertices."""
        return [] if self.solid is None else face_pieces(self.solid.vertices, self.solid.faces)

    @cached_property
    def lines(self) -> list[RoofLine]:
        """The lines of the solid's roof."""
        return [] if self.solid is None else roof_lines(self.solid)

    @cached_property
    def corner_sigmas(self) -> dict[int, list[Any]]:
        """Standard deviations of the roof's corners along x, y (None on a given outline) and z, by vertex."""
        if self.solid is None:
            return {}
        faces = zip(self.solid.faces, self.solid.semantics, strict=True)
        roofs = [face for face, kind in faces if kind == ROOF_SURFACE]
        rings = (
            (ring, own)
            for face, told in zip(roofs, self.roof_faces, strict=False)
            for ring, own in zip(face, told.get("corner_sigmas", ()), strict=False)
        )
        return {row: sigma for ring, own in rings for row, sigma in zip(ring, own, strict=False)}


@dataclass(frozen=True, eq=False)
class TerrainMesh:
    """The ground of one square as triangles; neighbouring squares share the vertices between them."""

    name: str  #: made from the coordinates of its north-western corner
    vertices: NDArray[np.float64]  #: map frame, whole millimetres [m], shape (n_vertices, 3)
    #: Rows of the vertices, counter-clockwise from above, shape (n_triangles, 3).
    triangles: NDArray[np.int32]


#: What a writer of a format gives: adds a building, or a piece of the terrain; one of layers takes façades,
#: too.
Add = Callable[[Any], None]


class ModelHeading(NamedTuple):
    """What the writers of all formats are told of a survey."""

    title: str = ""
    crs: str = ""  #: the reference system together with the vertical one, where that is known
    earth: EarthFrame | None = None  #: where the map frame lies on the earth, where that is known
    #: Of all coordinates of buildings and terrain: a `model_frame`.
    frame: MapFrame = MapFrame()
    extent: NDArray[np.float64] | None = None  #: of all solids, shape (2, 3), None if there are none [m]
    #: Name → type of every attribute of a building, in the order of the columns.
    fields: dict[str, type] = BUILDING_FIELDS
