"""Vegetation by height."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig

#: Lowest vegetation [m] (Mancera-Taboada and others, 2012): what is lower stays unclassified.
VEGETATION_FLOOR = 0.01


def vegetation_classes(height: NDArray[np.float64], config: RoofSelectionConfig) -> NDArray[np.uint8]:
    """
    Return low, medium or high vegetation by height, unclassified below and above (Mancera-Taboada, 2012).

    Of points that are neither ground nor roof; a limit belongs to the class above it.
    """
    limits = np.maximum.accumulate(
        [
            VEGETATION_FLOOR,
            config.low_vegetation_height,
            config.medium_vegetation_height,
            config.max_vegetation_height,
        ]
    )
    classes = (
        PointClass.UNCLASSIFIED,
        PointClass.LOW_VEGETATION,
        PointClass.MEDIUM_VEGETATION,
        PointClass.HIGH_VEGETATION,
        PointClass.UNCLASSIFIED,
    )
    return np.array(classes, dtype=np.uint8)[np.digitize(height, limits)]
