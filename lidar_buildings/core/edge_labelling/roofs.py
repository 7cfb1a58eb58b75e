"""
Which points are of one roof, and how roofs are kept from seeing one another.

"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.linked_sets import flatten, link
from lidar_buildings.core.neighbourhoods import CellGrid, build_grid


def roofs_in_plan(points: NDArray[np.float64], size: float) -> NDArray[np.int64]:
    """
    Number roofs from 0: points in square columns that touch, be it at a corner, are of one.

    Points less than `size` apart [m] are of one roof; no roof has a gap wider than 2√2 of it.

    """
    grid = build_grid(points, size)
    parent = np.arange(len(grid.adjacent))
    _link_adjacent(grid, parent)
    roof = np.empty(len(points), dtype=np.int64)
    roof[grid.rows] = np.unique(parent, return_inverse=True)[1].reshape(-1)[grid.cell]
    return roof


def set_apart(
    points: NDArray[np.float64], roof_id: NDArray[np.int64] | None, reach: float
) -> NDArray[np.float64]:
    """
    Return the points with roofs lifted so far above one another that none is within reach of another [m].

    The lift is a multiple of a power of two: coordinates that fit a float32 keep their differences exactly.

    """
    if roof_id is None or len(points) == 0:
        return points
    number = np.unique(roof_id, return_inverse=True)[1].reshape(-1)
    lift = 2.0 ** math.ceil(math.log2(np.ptp(points[:, 2]) + 2.0 * reach))
    return points + np.outer(number * lift, [0.0, 0.0, 1.0])


@njit(cache=True, nogil=True)
def _link_adjacent(grid: CellGrid, parent):  # type: ignore[no-untyped-def]
    """
    Link every column to those beside it.

    """
    for cell in range(len(parent)):
        for other in grid.adjacent[cell]:
            if other > cell:
                link(parent, cell, other)
    flatten(parent)
