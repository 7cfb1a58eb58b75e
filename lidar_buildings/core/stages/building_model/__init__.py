"""
Models of buildings at three levels of detail.

Constants were chosen on the virtual roofs of `bench.models.run` unless said otherwise.
"""

from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.core.stages.building_model.model import build_model
from lidar_buildings.core.stages.building_model.result import ATTRIBUTES, BuildingModel, RoofFaces

__all__ = ["ATTRIBUTES", "BuildingModel", "BuildingModelConfig", "RoofFaces", "build_model"]
