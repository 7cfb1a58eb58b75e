"""Given footprints instead of traced outlines: repaired, numbered, and the points of each."""

from lidar_buildings.core.stages.footprints.assignment import (
    AssignedPoints,
    assign_footprints,
    remark_on_points,
)
from lidar_buildings.core.stages.footprints.config import FootprintConfig
from lidar_buildings.core.stages.footprints.footprints import Footprints, footprints_of
from lidar_buildings.core.stages.footprints.repair import Repairs, repaired_polygons

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
