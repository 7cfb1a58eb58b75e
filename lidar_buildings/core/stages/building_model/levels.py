"""The solids of a building, one for each level of detail, and why a level is missing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.output_grid import elevation_on_grid, repaired_outlines
from lidar_buildings.core.solids.raising import RoofPiece, checked_roof_solid, extrude, extrusion_codes
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.stages.building_model.result import RoofFacePatch

#: Levels of detail (Biljecki et al. 2016), the finest last.
LOD12, LOD13, LOD22 = "1.2", "1.3", "2.2"


@dataclass(frozen=True, eq=False)
class Level:
    """One level of detail: a solid that passes all checks, or why there is none."""

    solid: Solid | None
    codes: tuple[int, ...] = ()  #: what is wrong with the first attempt, empty if there is a solid
    remark: str = ""  #: repair that it took; empty if none


def level_12(outline: Outline, ground: float, roof: float) -> tuple[Level, Outline]:
    """
    Raise an outline to one elevation, repairing it where its rings touch or cross; return it as it was used.
    """
    codes = extrusion_codes(outline, first := extrude(outline, ground, roof), roof - ground)
    if not codes:
        return Level(first), outline
    for repaired, what in repaired_outlines(outline):
        solid = extrude(repaired, ground, roof)
        if not extrusion_codes(repaired, solid, roof - ground):
            return Level(solid, (), what), repaired
    return Level(None, codes), outline


def level_13(faces: list[RoofFacePatch], elevations: FloatArray, ground: float) -> Level:
    """Raise every face to the elevation of its part, equal for the faces of one part [m]."""
    order = np.argsort(elevations, kind="stable")
    pieces = [RoofPiece(faces[k].rings, (0.0, 0.0, float(elevations[k]))) for k in order]
    return _level(*checked_roof_solid(pieces, ground, join_equal=True))


def level_22(faces: list[RoofFacePatch], ground: float) -> Level:
    """Raise every face to its plane."""
    pieces = [
        RoofPiece(face.rings, (float(face.plane[0]), float(face.plane[1]), float(face.plane[2])))
        for face in faces
    ]
    return _level(*checked_roof_solid(pieces, ground))


def part_elevations(
    faces: list[RoofFacePatch], points: FloatArray, elevation_of: Callable[[FloatArray], float]
) -> FloatArray:
    """
    Return the elevation of each face's part for LoD1.3 [m], on the output grid, as `elevation_of` has it.
    """
    members: dict[int, list[RoofFacePatch]] = {}
    for face in faces:
        members.setdefault(face.part, []).append(face)
    of_part = {}
    for part, own in members.items():
        rows = np.concatenate([face.rows for face in own])
        if len(rows):
            z = elevation_of(points[rows, 2])
        else:
            corners = [(face.plane, ring) for face in own for ring in face.rings]
            z = float(np.mean([np.mean(ring @ plane[:2] + plane[2]) for plane, ring in corners]))
        of_part[part] = elevation_on_grid(z)
    return np.array([of_part[face.part] for face in faces])


def _level(solid: Solid, codes: tuple[int, ...]) -> Level:
    return Level(None, codes) if codes else Level(solid)
