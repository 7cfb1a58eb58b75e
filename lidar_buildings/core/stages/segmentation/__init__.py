"""Segmentation: roof points that belong to one building."""

from lidar_buildings.core.stages.segmentation.config import AS_PUBLISHED, SegmentationConfig
from lidar_buildings.core.stages.segmentation.segmentation import Segmentation, segment_buildings

__all__ = ["AS_PUBLISHED", "Segmentation", "SegmentationConfig", "segment_buildings"]
