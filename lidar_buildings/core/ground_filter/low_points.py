"""
Gross errors: points far below the surface (multipath) and alone far above it (birds, clouds).

"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.asprs import PointClass
from lidar_buildings.core.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.point_order import numbered_cells


def find_noise(points: NDArray[np.float64], spacing: float, config: GroundFilterConfig) -> NDArray[np.uint8]:
    """
    Mark gross errors with their class, 7 or 18; 0 elsewhere.

    A point is low if, of all points within a radius, at most a small group lies lower than a gap above it:
    all others are higher by more. High points are found the same way upside down. Where no more than such a
    group is left beyond the gap, nothing is marked: there is nothing to tell it from.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In any order [m].
    spacing : float
        Point spacing of the ground's candidates [m].
    config : GroundFilterConfig
        Gaps, radius and group size.

    Returns
    -------
    ndarray of shape (n_points,), uint8

    """
    radius = config.noise_radius * spacing
    low = _stands_apart(points, radius, config.low_point_gap, config.noise_group)
    upside_down = points * [1.0, 1.0, -1.0]
    high = _stands_apart(upside_down, radius, config.high_point_gap, config.noise_group)
    noise = np.zeros(len(points), dtype=np.uint8)
    noise[high] = PointClass.HIGH_NOISE
    noise[low] = PointClass.LOW_NOISE
    return noise


def _stands_apart(points: NDArray[np.float64], radius: float, gap: float, group: int) -> NDArray[np.bool_]:
    """
    Return which points lie, but for at most `group` points, more than `gap` below all others within `radius`.

    """
    number, n_columns = numbered_cells(points, radius)
    order = np.argsort(number, kind="stable")
    cells, first = np.unique(number[order], return_index=True)
    first = np.append(first, len(points))
    apart = np.zeros(len(points), dtype=np.bool_)
    apart[order] = _apart(points[order], cells, first, n_columns, radius * radius, gap, group)
    return apart


@njit(cache=True, nogil=True)
def _apart(points, cells, first, n_columns, squared_radius, gap, group):  # type: ignore[no-untyped-def]
    """
    Judge points sorted by cell; `cells` holds the occupied cells' numbers, `first` where each begins.

    """
    apart = np.zeros(len(points), dtype=np.bool_)
    blocks = np.empty((3, 2), dtype=np.int64)
    for k in range(len(cells)):
        _rows_around(cells, first, k, n_columns, blocks)
        for i in range(first[k], first[k + 1]):
            apart[i] = _is_apart(points, i, blocks, squared_radius, gap, group)
    return apart


@njit(cache=True, nogil=True)
def _rows_around(cells, first, k, n_columns, blocks):  # type: ignore[no-untyped-def]
    """
    Set `blocks` to the first and last row of points of a cell and its neighbours, by row of cells.

    """
    column = cells[k] % n_columns
    west, east = min(column, 1), min(n_columns - 1 - column, 1)
    for step in range(3):
        middle = cells[k] + (0, -n_columns, n_columns)[step]
        blocks[step, 0] = first[np.searchsorted(cells, middle - west)]
        blocks[step, 1] = first[np.searchsorted(cells, middle + east + 1)]


@njit(cache=True, nogil=True)
def _is_apart(points, i, blocks, squared_radius, gap, group):  # type: ignore[no-untyped-def]
    """
    Whether at most `group` points in the blocks are not above point i by the gap, and more than that are.

    """
    n_beside, n_above = 0, 0
    for step in range(3):
        for j in range(blocks[step, 0], blocks[step, 1]):
            dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
            if dx * dx + dy * dy > squared_radius:
                continue
            if points[j, 2] > points[i, 2] + gap:
                n_above += 1
                continue
            n_beside += 1
            if n_beside > group:
                return False
    return n_above > group
