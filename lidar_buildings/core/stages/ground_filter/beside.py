"""Points judged against a terrain that others have told."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.neighbours.cell_grid import lowest_per_cell, rows_by_cell
from lidar_buildings.core.stages.ground_filter.config import CANDIDATE_SPACING, GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.progressive_tin import near_terrain
from lidar_buildings.core.surfaces.triangulation import build_tin


def judge_beside(
    points: NDArray[np.float64], ground: NDArray[np.float64], config: GroundFilterConfig
) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """
    Return class, 2 = ground or 1, and height of points above a terrain, shapes (n,) [m].

    `points` (n, 3) and those on the `ground` (n_ground, 3), one at least, are in any order [m]. Terrain goes
    through the lowest ground of small cells, as where it was found.
    """
    vertices = ground.take(lowest_per_cell(ground, CANDIDATE_SPACING), axis=0)
    extent = extent_of(np.concatenate([extent_of(points), extent_of(ground)]))[:, :2]
    cells = rows_by_cell(points, CANDIDATE_SPACING)  # near ones are found quickly one after the other
    elevation, slope = build_tin(vertices, extent).elevation_and_slope(cells.points)
    height, classes = np.empty(len(points)), np.empty(len(points), dtype=np.uint8)
    height[cells.rows] = own = cells.points[:, 2] - elevation
    classes[cells.rows] = np.where(
        near_terrain(own, slope, config), PointClass.GROUND, PointClass.UNCLASSIFIED
    )
    return classes, height
