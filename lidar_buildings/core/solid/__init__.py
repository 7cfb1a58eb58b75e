"""
Solids: closed shells of planar faces, extruded from outlines or from roofs in pieces.

"""

from lidar_buildings.core.shell import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE, Face, Solid
from lidar_buildings.core.solid.extrusion import extrude
from lidar_buildings.core.solid.roof_piece import RoofPiece
from lidar_buildings.core.solid.roof_solid import checked_roof_solid, roof_solid

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
