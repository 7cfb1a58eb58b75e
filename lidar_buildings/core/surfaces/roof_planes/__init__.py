"""The planes of a roof: what finding them and building models from them share."""

from lidar_buildings.core.surfaces.roof_planes.adjustment import (
    Adjustment,
    adjust,
    common_point,
    fitted_planes,
)
from lidar_buildings.core.surfaces.roof_planes.normal_equations import CommonVertex
from lidar_buildings.core.surfaces.roof_planes.roof_plane import RoofPlane, without_gaps

__all__ = [
    "Adjustment",
    "CommonVertex",
    "RoofPlane",
    "adjust",
    "common_point",
    "fitted_planes",
    "without_gaps",
]
