"""
How bare the land is: how little stands on the terrain around.

"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.point_order import sort_by_cell

#: Side of the cells that are counted [m], and how many of them around count.
CELL, RADIUS = 10.0, 6
#: Share of objects up to which land is bare, and from which on it is not at all.
BARE_SHARE, BUILT_SHARE = 0.04, 0.15


def measure_bareness(candidates: NDArray[np.float64], standing: NDArray[np.bool_]) -> NDArray[np.float64]:
    """
    Return how bare the land around each candidate is, 0 to 1.

    Cells up to 60 m away along x and y are weighted by a bell curve (σ = 30 m); what counts is the share of
    their candidates that stand on the terrain beyond doubt.

    Parameters
    ----------
    candidates : ndarray of shape (n_candidates, 3)
        At least one [m].
    standing : ndarray of shape (n_candidates,), bool
        Which of them are objects beyond doubt.

    """
    cells = sort_by_cell(candidates, CELL)
    n_standing = np.add.reduceat(standing[cells.rows].astype(np.float64), cells.first[:-1])
    n_all = np.diff(cells.first).astype(np.float64)
    share = np.divide(*_smoothed(cells.numbers, cells.n_columns, np.stack((n_standing, n_all))))
    bareness = np.empty(len(candidates))
    bare = np.clip((BUILT_SHARE - share) / (BUILT_SHARE - BARE_SHARE), 0.0, 1.0)
    bareness[cells.rows] = np.repeat(bare, np.diff(cells.first))
    return bareness


def _smoothed(numbers: NDArray[np.int64], n_columns: int, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return the weighted sums of values (k, n_cells) over the cells around; only occupied cells take part.

    """
    total = np.zeros_like(values)
    column = numbers % n_columns
    for north in range(-RADIUS, RADIUS + 1):
        for east in range(-RADIUS, RADIUS + 1):
            there = numbers + north * n_columns + east
            k = np.minimum(np.searchsorted(numbers, there), len(numbers) - 1)
            known = (numbers[k] == there) & (column + east >= 0) & (column + east < n_columns)
            weight = math.exp(-2.0 * (north * north + east * east) / RADIUS**2)
            total[:, known] += weight * values[:, k[known]]
    return total
