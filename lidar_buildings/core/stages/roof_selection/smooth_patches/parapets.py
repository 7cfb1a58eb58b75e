"""Parapets: thin rims that stand a little higher than the roof beside them, all along."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.neighbourhoods import build_grid, neighbours_of
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.surfaces.surface_patches import connected_parts

#: How far from the roof in plan a parapet's points lie, at least in radii of neighbourhoods [m].
REACH = 1.0
#: How far a parapet rises above the lowest of the roof beside it; railings and fire walls hardly higher [m].
MIN_RISE = 0.2
MAX_RISE = 1.5
#: Standard deviation of that rise along one parapet: leaves beside a roof are at any height [m].
MAX_UNEVENNESS = 0.2
#: Shortest diagonal of a parapet's bounds in plan [m].
MIN_LENGTH = 2.0


def find_parapets(
    points: NDArray[np.float64],
    roof: NDArray[np.bool_],
    surface: NDArray[np.bool_],
    radius: float,
) -> NDArray[np.bool_]:
    """
    Tell which points are of connected rims, all along about as high above the roof beside them.

    Whichever the return: pulses are split at edges.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In any order [m].
    roof : ndarray of bool, shape (n_points,)
        Which points are roof already; the answer for them is False.
    surface : ndarray of bool, shape (n_points,)
        Which of them are smooth roof, above which rims rise.
    radius : float
        Longest step along a rim [m].
    """
    rise = np.full(len(points), np.inf)
    reach = max(REACH, radius)
    grid = build_grid(points, reach)
    for_row_blocks(lambda begin, end: _rises(grid, roof, surface, reach, rise, begin, end), len(points))
    rows = np.flatnonzero((rise >= MIN_RISE) & (rise <= MAX_RISE))
    found = np.zeros(len(points), dtype=bool)
    if len(rows) == 0:
        return found
    part = connected_parts(points[rows], radius)
    found[rows] = (_is_even(rise[rows], part) & (_lengths(points[rows], part) >= MIN_LENGTH))[part]
    return found


def _is_even(rise: NDArray[np.float64], part: NDArray[np.int64]) -> NDArray[np.bool_]:
    n = np.bincount(part)
    mean = np.bincount(part, rise) / n
    return np.sqrt(np.bincount(part, (rise - mean[part]) ** 2) / n) <= MAX_UNEVENNESS


def _lengths(points: NDArray[np.float64], part: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the diagonals of the parts' bounds in plan [m]."""
    low, high = np.full((part.max() + 1, 2), np.inf), np.full((part.max() + 1, 2), -np.inf)
    np.minimum.at(low, part, points[:, :2])
    np.maximum.at(high, part, points[:, :2])
    return np.hypot(*(high - low).T)


@njit(cache=True, nogil=True)
def _rises(grid, roof, surface, reach, rise, begin, end):  # type: ignore[no-untyped-def]
    """Measure how far points rise above the lowest surface beside them, if none is higher."""
    near = np.empty(len(grid.points), dtype=np.int64)
    for i in range(begin, end):
        row = grid.rows[i]
        if roof[row]:
            continue
        x, y, z = grid.points[i]
        lowest, highest = np.inf, -np.inf
        for k in range(neighbours_of(grid, grid.cell[i], x, y, z, reach, True, near)):
            if surface[grid.rows[near[k]]]:
                lowest = min(lowest, grid.points[near[k], 2])
                highest = max(highest, grid.points[near[k], 2])
        if highest <= z:
            rise[row] = z - lowest
