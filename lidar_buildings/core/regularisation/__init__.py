"""
Regularisation: straight walls and right angles from a traced outline.

"""

from lidar_buildings.core.regularisation.regularising import (
    OutlineQuality,
    RegularisationConfig,
    RegularisedOutline,
    measure_outline,
    regularise_outline,
)

__all__ = [
    "OutlineQuality",
    "RegularisationConfig",
    "RegularisedOutline",
    "measure_outline",
    "regularise_outline",
]
