"""
The ground filter: which points are ground, and how high above it the others are.

`classification` is the stage; `gross_errors` runs first; then one of the methods, each in a folder of its
own: `growing_tin` (``progressive_tin``), `scan_profiles` (``bidirectional_slope``), `openings`
(``morphological``); or all three, of which `consensus` takes the majority.
"""

from lidar_buildings.core.stages.ground_filter.classification import GroundResult, classify_ground
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.overlap import used_classes

__all__ = ["GroundFilterConfig", "GroundResult", "classify_ground", "used_classes"]
