"""
The stage: noise, terrain, and every point judged against it.

"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.asprs import PointClass
from lidar_buildings.core.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.ground_filter.low_points import find_noise
from lidar_buildings.core.ground_filter.progressive_tin import densify
from lidar_buildings.core.point_array import checked_points
from lidar_buildings.core.point_order import lowest_per_cell
from lidar_buildings.core.point_spacing import quantised_spacing

#: Slope beyond which the tolerance of ground no longer grows: a wall has no ground on it.
MAX_SLOPE = 3.0


@dataclass(frozen=True, eq=False)
class GroundResult:
    """
    What `classify_ground` found, one value per point in the order given.

    Attributes
    ----------
    classification : ndarray of shape (n_points,), uint8
        2 = ground, 7 = low noise, 18 = high noise, 1 = everything else.
    height_above_ground : ndarray of shape (n_points,), float64
        Height above the terrain [m]; finite for every point, negative below the terrain.

    """

    classification: NDArray[np.uint8]
    height_above_ground: NDArray[np.float64]


def classify_ground(points: ArrayLike, config: GroundFilterConfig | None = None) -> GroundResult:
    """
    Tell ground from everything else, and measure how high each point lies above it.

    Progressive TIN densification (Axelsson 2000): gross errors are set aside; the lowest points of large
    cells form a first, coarse TIN; points that lie near its facets join it, round by round, until none is
    left; points close to the finished TIN are ground.

    The lowest surface is ground by definition. Where no ground was recorded (a tile that shows one roof
    only), that is the roof, and heights are measured from it; there is no result without a terrain.

    Parameters
    ----------
    points : array_like of shape (n_points, 3)
        Last or all returns, in any order [m].
    config : GroundFilterConfig, optional
        Thresholds; the defaults serve town and country.

    Returns
    -------
    GroundResult

    Raises
    ------
    ValueError
        If `points` has another shape or is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> x, y = np.meshgrid(np.arange(20.0), np.arange(20.0))
    >>> roof = (abs(x - 10) < 4) & (abs(y - 10) < 4)
    >>> result = classify_ground(np.column_stack((x.ravel(), y.ravel(), 5.0 * roof.ravel())))
    >>> bool((result.classification[~roof.ravel()] == 2).all())
    True
    >>> float(result.height_above_ground.max())
    5.0

    """
    config = config or GroundFilterConfig()
    points = checked_points(points)
    if len(points) == 0:
        return GroundResult(np.zeros(0, dtype=np.uint8), np.zeros(0))
    sample = points[lowest_per_cell(points, config.candidate_spacing)]
    classification = find_noise(points, quantised_spacing(sample), config)
    surface = points[classification == 0]
    candidates = surface[lowest_per_cell(surface, config.candidate_spacing)]
    terrain = densify(candidates, np.array([points.min(axis=0)[:2], points.max(axis=0)[:2]]), config)
    elevation, slope = terrain.elevation_and_slope(points)
    height = points[:, 2] - elevation
    tolerance = config.ground_distance + config.ground_distance_slope * np.minimum(slope, MAX_SLOPE)
    ground = np.abs(height) <= tolerance
    classification[classification == 0] = PointClass.UNCLASSIFIED
    classification[ground & (classification == PointClass.UNCLASSIFIED)] = PointClass.GROUND
    return GroundResult(classification, height)
