"""
The planes of a roof: what finding them and building models from them share.

"""

from lidar_buildings.core.roof_planes.adjustment import adjust_planes
from lidar_buildings.core.roof_planes.roof_plane import RoofPlane

__all__ = ["RoofPlane", "adjust_planes"]
