"""Checks of solids by ISO 19107."""

from lidar_buildings.core.solids.validity.checking import check_solid
from lidar_buildings.core.solids.validity.codes import CODES, MAX_PLANE_DISTANCE

__all__ = ["CODES", "MAX_PLANE_DISTANCE", "check_solid"]
