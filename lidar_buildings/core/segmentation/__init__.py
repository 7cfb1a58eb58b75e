"""
Segmentation: roof points that belong to one building.

"""

from lidar_buildings.core.segmentation.segmentation import Segmentation, SegmentationConfig, segment_buildings

__all__ = ["Segmentation", "SegmentationConfig", "segment_buildings"]
