"""
Given footprints instead of traced outlines: repaired, numbered, and the points of each.

"""

from lidar_buildings.core.footprints.assignment import AssignedPoints, assign_footprints
from lidar_buildings.core.footprints.config import FootprintConfig
from lidar_buildings.core.footprints.footprints import Footprints, footprints_of
from lidar_buildings.core.footprints.remark import remark_on_points
from lidar_buildings.core.footprints.repair import Repairs, repaired_polygons

__all__ = [
    "AssignedPoints",
    "FootprintConfig",
    "Footprints",
    "Repairs",
    "assign_footprints",
    "footprints_of",
    "remark_on_points",
    "repaired_polygons",
]
