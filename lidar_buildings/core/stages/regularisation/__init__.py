"""Regularisation: straight walls, right angles and arcs from a traced outline."""

from lidar_buildings.core.stages.regularisation.config import AS_PUBLISHED, RegularisationConfig
from lidar_buildings.core.stages.regularisation.regularising import outline_quality, regularise_outline
from lidar_buildings.core.stages.regularisation.result import OutlineWall, RegularisedOutline
from lidar_buildings.core.stages.regularisation.samples import ring_spacing, working_spacing

__all__ = [
    "AS_PUBLISHED",
    "OutlineWall",
    "RegularisationConfig",
    "RegularisedOutline",
    "outline_quality",
    "regularise_outline",
    "ring_spacing",
    "working_spacing",
]
