"""Which points are ground, once the terrain is known: those near it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig

#: Slope beyond which the tolerance of ground no longer grows: a wall has no ground on it.
MAX_SLOPE = 3.0


def near_terrain(
    height: NDArray[np.float64], slope: NDArray[np.float64], config: GroundFilterConfig
) -> NDArray[np.bool_]:
    """
    Return which points lie so near the terrain, above or below, that they are ground.

    Parameters
    ----------
    height : ndarray of shape (n_points,)
        Height above the terrain, negative below it [m].
    slope : ndarray of shape (n_points,)
        The terrain's rise over run there.
    config : GroundFilterConfig
        Tolerances.
    """
    tolerance = config.ground_distance + config.ground_distance_slope * np.minimum(slope, MAX_SLOPE)
    return np.abs(height) <= tolerance
