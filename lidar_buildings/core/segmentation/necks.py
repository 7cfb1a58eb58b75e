"""
Buildings that hang together by a neck of few points, cut apart.

"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.point_order import sort_by_cell
from lidar_buildings.core.segmentation.members import occupied_areas
from lidar_buildings.core.segmentation.windows import chain_windows

#: Half the side of the square in which a point that joins two roofs all by itself has no other [spacings].
ALONE = 1.25


def cut_necks(
    positions: NDArray[np.float64], window: float, min_neck: float, min_points: int, min_area: float
) -> NDArray[np.int64]:
    """
    Number the parts of one component that only necks join.

    A point is in a neck if its window holds fewer positions than a strip of the least width would, or if it
    stands alone amid a gap; the other points are chained without them, as in DBSCAN (Ester and others, 1996).
    Where at least two of the chains are as large as a building these are parts, and every other point goes to
    the part whose point is nearest.

    Parameters
    ----------
    positions : ndarray of shape (n_points, 2)
        In units of the spacing, in any order.
    window : float
        Side of the window [spacings].
    min_neck : float
        Least width [spacings].
    min_points, min_area : int, float
        Of a building; the area in units of the spacing squared.

    """
    half = window / 2.0
    cloud = sort_by_cell(np.column_stack((positions, np.zeros(len(positions)))), half)
    is_first = _first_copies(cloud)
    is_core = np.empty(len(positions), dtype=np.bool_)
    # A strip of width w has w points a spacing.
    needed = math.ceil(min_neck * window)
    _mark_core(cloud, is_first, half, needed, is_core)
    part = np.zeros(len(positions), dtype=np.int64)
    if not is_core.all() and is_core.any():
        part[cloud.rows] = _parts(cloud.points[:, :2], is_core, is_first, half, min_points, min_area)
    return part


def _parts(
    places: NDArray[np.float64],
    is_core: NDArray[np.bool_],
    is_first: NDArray[np.bool_],
    half: float,
    min_points: int,
    min_area: float,
) -> NDArray[np.int64]:
    """
    Chain the core and give every other point to the nearest part that is as large as a building.

    """
    core = places[is_core]
    part, n_parts = chain_windows(core, (half, half))
    first = is_first[is_core]
    is_large = np.bincount(part, minlength=n_parts) >= min_points
    is_large &= occupied_areas(core[first], part[first], n_parts, 1.0) >= min_area
    number = np.zeros(len(places), dtype=np.int64)
    if np.count_nonzero(is_large) < 2:
        return number
    # Parts are numbered from the south-west, whatever the points' order.
    number[is_core] = np.where(is_large, np.cumsum(is_large) - 1, -1)[part]
    number[~is_core] = -1
    is_member = number >= 0
    nearest = cKDTree(places[is_member]).query(places[~is_member])[1]
    number[~is_member] = number[is_member][nearest]
    return number


@njit(cache=True, nogil=True)
def _first_copies(cloud):  # type: ignore[no-untyped-def]
    """
    Return which of the sorted points are not copies of the one before.

    """
    points = cloud.points
    is_first = np.ones(len(points), dtype=np.bool_)
    for i in range(1, len(points)):
        is_first[i] = points[i, 0] != points[i - 1, 0] or points[i, 1] != points[i - 1, 1]
    return is_first


@njit(cache=True, nogil=True)
def _mark_core(cloud, is_first, half, needed, is_core):  # type: ignore[no-untyped-def]
    """
    Mark the sorted points that have `needed` positions in their windows and do not stand alone.

    """
    for cell in range(len(cloud.numbers)):
        column = cloud.numbers[cell] % cloud.n_columns
        west, east = min(1, column), min(1, cloud.n_columns - 1 - column)
        runs = np.empty((3, 2), dtype=np.int64)
        for row in range(3):
            beside = cloud.numbers[cell] + (row - 1) * cloud.n_columns
            runs[row, 0] = cloud.first[np.searchsorted(cloud.numbers, beside - west)]
            runs[row, 1] = cloud.first[np.searchsorted(cloud.numbers, beside + east, side="right")]
        for i in range(cloud.first[cell], cloud.first[cell + 1]):
            is_core[i] = _is_core(cloud.points, runs, is_first, i, half, needed)


@njit(cache=True, nogil=True)
def _is_core(points, runs, is_first, i, half, needed):  # type: ignore[no-untyped-def]
    """
    Whether a point has enough positions in its window, its own among them, and another near by.

    """
    count, is_alone = 0, True
    for run in range(3):
        for j in range(runs[run, 0], runs[run, 1]):
            far = max(abs(points[j, 0] - points[i, 0]), abs(points[j, 1] - points[i, 1]))
            if not is_first[j] or far > half:
                continue
            count += 1
            is_alone = is_alone and (far == 0.0 or far > ALONE)
            if count >= needed and not is_alone:
                return True
    return False
