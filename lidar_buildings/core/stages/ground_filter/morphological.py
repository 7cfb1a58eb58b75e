"""The morphological filter: what growing discs, pushed up from below, do not reach is no ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.surfaces.opened_terrain import opened_terrain

#: Points this near the terrain that the openings leave are ground; so much more per unit of its slope [m];
#: chosen with `bench.ground.isprs` and `bench.ground.scenes`.
DISTANCE, DISTANCE_SLOPE = 0.3, 1.25


def label_ground(points: NDArray[np.float64], config: GroundFilterConfig) -> NDArray[np.bool_]:
    """
    Return which points are ground, by a progressive morphological filter (Zhang et al. 2003).

    Those within a distance of the terrain left that grows with its slope (Pingel et al. 2013). Points come in
    any order, gross errors removed.
    """
    elevation, slope = opened_terrain(points, config.opening_radius, config.opening_slope)
    return np.abs(points[:, 2] - elevation) <= DISTANCE + DISTANCE_SLOPE * slope
