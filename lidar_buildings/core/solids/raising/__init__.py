"""Solids: closed shells of planar faces, extruded from outlines or from roofs in pieces."""

from lidar_buildings.core.solids.raising.extrusion import extrude
from lidar_buildings.core.solids.raising.roof_piece import RoofPiece
from lidar_buildings.core.solids.raising.roof_solid import checked_roof_solid, roof_solid
from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE, Face, Solid

__all__ = [
    "GROUND_SURFACE",
    "ROOF_SURFACE",
    "WALL_SURFACE",
    "Face",
    "RoofPiece",
    "Solid",
    "checked_roof_solid",
    "extrude",
    "roof_solid",
]
