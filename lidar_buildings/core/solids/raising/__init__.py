"""Solids raised from outlines or from roofs in pieces."""

from lidar_buildings.core.solids.raising.extrusion import extrude, extrusion_codes
from lidar_buildings.core.solids.raising.roof_piece import RoofPiece
from lidar_buildings.core.solids.raising.roof_solid import checked_roof_solid, roof_solid

__all__ = ["RoofPiece", "checked_roof_solid", "extrude", "extrusion_codes", "roof_solid"]
