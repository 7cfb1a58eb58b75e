"""Checks of solids by ISO 19107."""

from lidar_buildings.core.solids.validity.checking import check_solid
from lidar_buildings.core.solids.validity.codes import CODES, MAX_PLANE_DISTANCE
from lidar_buildings.core.solids.validity.voids import check_solid_with_voids

__all__ = ["CODES", "MAX_PLANE_DISTANCE", "check_solid", "check_solid_with_voids"]
