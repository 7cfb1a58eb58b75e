"""Points that lie so far apart that one window of cells around them would be nearly empty."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.neighbours.union_find import sets_of_pairs

#: Windows of fewer cells may be as empty as they are: some 1 GB.
_SMALL = 25_000_000
#: A window of which less than one in so many squares holds a point is nearly empty.
_SPARSITY = 16


def is_wide(extent: NDArray[np.float64], resolution: float) -> bool:
    """Whether a window of cells round an extent, shape (2, 2) [m], is too large to be nearly empty."""
    return bool(np.prod(np.diff(extent, axis=0) / resolution) > _SMALL)


def main_area(points: NDArray[np.float64], square: float) -> NDArray[np.bool_]:
    """
    Tell which points a window of cells is worth its memory for: mostly all.

    A single point 10 km from a tile would make a window of gigabytes. Where it would be nearly empty the
    group of adjoining squares with the most points is kept; of equal ones the westernmost, then southernmost.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        [m]
    square : float
        Side of a square [m].
    """
    squares, at, count = np.unique(
        np.floor(points[:, :2] / square).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    wide, high = (squares.max(axis=0) - squares.min(axis=0) + 1).tolist()
    if wide * high <= _SPARSITY * len(squares):
        return np.ones(len(points), dtype=bool)
    group = sets_of_pairs(len(squares), *cKDTree(squares).query_pairs(1.5, output_type="ndarray").T)
    return np.asarray(group[at.ravel()] == np.argmax(np.bincount(group, weights=count)))
