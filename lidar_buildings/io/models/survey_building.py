"""A building of a survey and a piece of its terrain, as the formats of city models are given them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.face_triangles import face_pieces
from lidar_buildings.core.solids.roof_lines import RoofLine, roof_lines
from lidar_buildings.core.solids.shell import Solid


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


@dataclass(frozen=True, eq=False)
class TerrainMesh:
    """The ground of one square as triangles; neighbouring squares share the vertices between them."""

    name: str  #: made from the coordinates of its north-western corner
    vertices: NDArray[np.float64]  #: map frame, whole millimetres [m], shape (n_vertices, 3)
    #: Rows of the vertices, counter-clockwise from above, shape (n_triangles, 3).
    triangles: NDArray[np.int32]
