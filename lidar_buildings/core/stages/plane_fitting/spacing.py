"""The point spacing of a building where it is not given."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.neighbours.cell_grid import rows_by_cell
from lidar_buildings.core.neighbours.group_spacing import group_spacings
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.core.stages.plane_fitting.surroundings import distinct_grid

#: Side of the cells in which points are sorted, and in which neighbours are sought [guessed spacings].
_SORTED, _SOUGHT = 4.0, 1.5


def building_spacing(points: FloatArray) -> float:
    """
    Measure the spacing from a sample of the distinct positions, or from all of them where that fails [m].

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In any order, repetitions allowed [m].
    """
    width, height = np.ptp(points[:, :2], axis=0)
    # As if the points filled their bounding box: cells a little too large only cost time.
    guess = float(np.sqrt(width / len(points)) * np.sqrt(height))
    if not 0.0 < guess < np.inf:
        return measure_spacing(points)
    # Layers that lie over one another make a cloud no denser.
    plan = points.copy()
    plan[:, 2] = 0.0
    distinct = distinct_grid(plan, _SORTED * guess)[0].points
    group = np.zeros(len(distinct), dtype=np.int64)
    spacing = float(group_spacings(distinct, rows_by_cell(distinct, _SOUGHT * guess), group, 1)[0])
    return spacing if np.isfinite(spacing) else measure_spacing(points)
