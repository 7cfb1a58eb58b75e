"""
Buildings that hang together by a neck of few points, cut apart.

"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

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
    whole = np.zeros(len(positions), dtype=np.int64)
    half = window / 2.0
    places, place = np.unique(positions, axis=0, return_inverse=True)
    tree = cKDTree(places)
    count = tree.query_ball_point(places, half, p=np.inf, return_length=True)
    alone = tree.query_ball_point(places, ALONE, p=np.inf, return_length=True) == 1
    # A strip of width w has w points a spacing.
    is_core = (count >= min_neck * window) & ~alone
    if is_core.all() or not is_core.any():
        return whole
    core = places[is_core]
    part, n_parts = chain_windows(core, (half, half))
    n_points = np.bincount(place.ravel(), minlength=len(places))[is_core]
    is_large = np.bincount(part, weights=n_points, minlength=n_parts) >= min_points
    is_large &= occupied_areas(core, part, n_parts, 1.0) >= min_area
    if np.count_nonzero(is_large) < 2:
        return whole
    number = np.where(is_large, np.cumsum(is_large) - 1, -1)
    kept = is_large[part]
    nearest = cKDTree(core[kept]).query(places)[1]
    return number[part[kept][nearest]][place.ravel()]
