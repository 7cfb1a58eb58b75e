"""Roof selection: find the roofs among all points, and give every point its final class."""

from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.selection import RoofSelection, select_roofs

__all__ = ["RoofSelection", "RoofSelectionConfig", "select_roofs"]
