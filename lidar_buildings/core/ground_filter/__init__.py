"""
The ground filter: which points are ground, and how high above it the others are.

"""

from lidar_buildings.core.ground_filter.classification import GroundResult, classify_ground
from lidar_buildings.core.ground_filter.config import GroundFilterConfig

__all__ = ["GroundFilterConfig", "GroundResult", "classify_ground"]
