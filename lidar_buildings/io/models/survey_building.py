"""A building of a survey, as the formats of city models are given it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.face_triangles import face_pieces
from lidar_buildings.core.solids.roof_lines import RoofLine, roof_lines
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.io.models.cityjson import CityFeature


@dataclass(frozen=True, eq=False)
class SolidMesh:
    """
    A solid with its faces divided into convex pieces of three or four corners.

    Attributes
    ----------
    lod : str
        The solid's level of detail.
    solid : Solid
    pieces : tuple of tuple of tuple of int
        Per face its pieces, as rows of the solid's vertices.
    """

    lod: str
    solid: Solid
    pieces: tuple[tuple[tuple[int, ...], ...], ...]


@dataclass(frozen=True, eq=False)
class SurveyBuilding:
    """
    One building, as far as the run went.

    Attributes
    ----------
    building_id : int
        See `lidar_buildings.core.model.ids`.
    readable_id : str
        The name that files carry, made from the anchor's coordinates.
    traced, outline : Outline or None
        Before and after regularisation, map frame [m].
    line : str
        The CityJSONFeature, empty if there is none.
    feature : CityFeature or None
        What the line says.
    attributes : dict
        In the source's units.
    """

    building_id: int
    readable_id: str
    traced: Outline | None
    outline: Outline | None
    line: str
    feature: CityFeature | None
    attributes: dict[str, Any]

    @cached_property
    def mesh(self) -> SolidMesh | None:
        """The finest solid with its faces divided, None if there is no solid."""
        if self.feature is None or not self.feature.finest:
            return None
        solid = self.feature.solids[self.feature.finest]
        pieces = tuple(tuple(face_pieces(solid.vertices, face)) for face in solid.faces)
        return SolidMesh(self.feature.finest, solid, pieces)

    @cached_property
    def lines(self) -> list[RoofLine]:
        """The lines of the finest solid's roof."""
        has_solid = self.feature is not None and self.feature.finest
        return roof_lines(self.feature.solids[self.feature.finest]) if self.feature and has_solid else []
