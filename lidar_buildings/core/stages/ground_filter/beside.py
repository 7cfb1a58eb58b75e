"""Points seen from the street, judged against a terrain that others have told."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.neighbours.cell_grid import in_rows_order, lowest_per_cell, rows_by_cell
from lidar_buildings.core.stages.ground_filter.config import CANDIDATE_SPACING, GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.street_ground import street_ground
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
    height = cells.points[:, 2] - build_tin(vertices, extent).elevation(cells.points)
    is_ground = street_ground(cells, np.ones(len(points), dtype=bool), height, config.ground_distance)
    classes = np.where(is_ground, PointClass.GROUND, PointClass.UNCLASSIFIED).astype(np.uint8)
    return in_rows_order(cells, classes), in_rows_order(cells, height)
