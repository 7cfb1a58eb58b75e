"""
Checks of solids by ISO 19107.

"""

from lidar_buildings.core.validity.checking import check_solid
from lidar_buildings.core.validity.codes import CODES, MAX_PLANE_DISTANCE
from lidar_buildings.core.validity.voids import check_solid_with_voids

__all__ = ["CODES", "MAX_PLANE_DISTANCE", "check_solid", "check_solid_with_voids"]
