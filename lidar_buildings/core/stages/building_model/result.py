"""What is known of one building."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.model.grade import Doubt
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.solids.shell import ROOF_SURFACE, Solid

#: Names of a model's attributes, whatever becomes of it.
ATTRIBUTES = (
    "ground_elevation",
    "ground_elevation_min",
    "ground_elevation_max",
    "roof_elevation_min",
    "roof_elevation_50p",
    "roof_elevation_70p",
    "roof_elevation_max",
    "height",
    "area",
    "n_points",
    "point_spacing",
    "n_planes",
    "roof_type",
    "conditions",
    "rmse",
    "coverage",
    "no_data_share",
    "plane_sigma",
    "corner_sigma_xy",
    "corner_sigma_z",
    "volume",
    "lod",
    "validity",
    "quality",
    "quality_reasons",
)


@dataclass(frozen=True, eq=False)
class BuildingModel:
    """What is known of one building."""

    solids: dict[str, Solid]  #: by level of detail ("1.2"); valid ones only
    #: By the names of doc/formats.md; elevations [m] in the map frame, None where unknown.
    attributes: dict[str, Any]
    #: OK, NO_SOLID or DEGENERATE; FAILED in place of a model that could not be built.
    status: BuildingStatus = BuildingStatus.OK
    reason: str = ""  #: why not OK, or what was assumed or repaired
    doubts: tuple[Doubt, ...] = ()  #: what speaks against it
    #: By level of detail, for each face of its solid: how sure it is (`told_precision`) and what walls seen
    #: from the street tell of it, as `seen_share` of walls and `thickness` of eaves [m].
    of_faces: dict[str, tuple[dict[str, Any], ...]] = field(default_factory=dict)

    @property
    def roof_faces(self) -> tuple[tuple[FloatArray, ...], ...]:
        """Faces of the finest solid's roof: rings of shape (n, 3) each, the exterior first [m]."""
        if not self.solids:
            return ()
        finest = self.solids[max(self.solids)]
        faces = zip(finest.faces, finest.semantics, strict=True)
        return tuple(finest.face_rings(face) for face, kind in faces if kind == ROOF_SURFACE)


@dataclass(frozen=True, eq=False)
class RoofFacePatch:
    """A roof face: a polygon in plan with one plane, and its points."""

    #: Outer ring counter-clockwise, then holes clockwise, open [m], shape (n_vertices, 2).
    rings: tuple[FloatArray, ...]
    plane: FloatArray  #: z = a·x + b·y + c, shape (3,)
    rows: IntArray  #: rows of the building's points over the face, shape (n_points,)
    part: int = 0  #: number of the part of the roof that has one height in LoD1.3
