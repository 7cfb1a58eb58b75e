"""Terrain: the ground's TIN as elevations anywhere, heights above it, and rasters of ground and surface."""

from lidar_buildings.core.stages.terrain.config import RasterConfig
from lidar_buildings.core.stages.terrain.rasters import TerrainRasters, make_rasters
from lidar_buildings.core.stages.terrain.window import RasterWindow

__all__ = ["RasterConfig", "RasterWindow", "TerrainRasters", "make_rasters"]
