"""Canopies: what stands above a roof and lets pulses through to it, as crowns do and chimneys do not."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.neighbourhoods import build_grid, neighbours_of
from lidar_buildings.core.stages.roof_selection.sectors import N_SECTORS, sector_of
from lidar_buildings.core.surfaces.surface_patches import connected_parts

#: Roof so far below other points is below a canopy and not beside it [m].
MIN_GAP = 0.8
#: How far around a roof point to look for the canopy in plan, in smallest radii of neighbourhoods.
REACH_RADII = 1.0
#: Sectors of eight that have to show canopy: a point at the foot of a straight wall sees it in five.
MIN_SECTORS = 6
#: Roof points below a part per point of it, from which on it is a canopy.
MAX_SEEN_THROUGH = 0.1
#: Thinner parts are no crowns but louvres, sails and solar panels [m].
MIN_THICKNESS = 2.5


def is_canopy(
    points: NDArray[np.float64],
    roof: NDArray[np.bool_],
    above: NDArray[np.bool_],
    radius: float,
) -> NDArray[np.bool_]:
    """
    Tell which of the points that may stand on roofs are of parts through which the roof below is seen.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In any order [m].
    roof : ndarray of bool, shape (n_points,)
        Which points are roof.
    above : ndarray of bool, shape (n_points,)
        Which others may be canopy; parts are what steps of a radius connect among them.
    radius : float
        Radius of a neighbourhood [m].
    """
    canopy = np.zeros(len(points), dtype=bool)
    rows = np.flatnonzero(above)
    if len(rows) == 0:
        return canopy
    part = np.full(len(points), -1, dtype=np.int64)
    part[rows] = connected_parts(points[rows], radius)
    rows_of_both = np.flatnonzero(above | roof)
    grid = build_grid(points[rows_of_both], REACH_RADII * radius)
    counts = np.zeros(part.max() + 1, dtype=np.int64)
    _count_seen(grid, part[rows_of_both][grid.rows], REACH_RADII * radius, counts)
    low, high = np.full(len(counts), np.inf), np.full(len(counts), -np.inf)
    np.minimum.at(low, part[rows], points[rows, 2])
    np.maximum.at(high, part[rows], points[rows, 2])
    is_seen_through = counts > MAX_SEEN_THROUGH * np.bincount(part[rows])
    canopy[rows] = (is_seen_through & (high - low >= MIN_THICKNESS))[part[rows]]
    return canopy


@njit(cache=True, nogil=True)
def _count_seen(grid, part, reach, counts):  # type: ignore[no-untyped-def]
    """Count for each part the roof points (of no part) that it hangs over, seen in most directions."""
    points = grid.points
    near = np.empty(len(points), dtype=np.int64)
    seen = np.zeros(N_SECTORS, dtype=np.bool_)
    counted_last = np.full(len(counts), -1, dtype=np.int64)
    for i in range(len(points)):
        if part[i] >= 0:
            continue
        x, y, z = points[i]
        found = neighbours_of(grid, grid.cell[i], x, y, z, reach, True, near)
        seen[:] = False
        for k in range(found):
            j = near[k]
            if part[j] >= 0 and points[j, 2] >= z + MIN_GAP:
                seen[sector_of(points[j, 0] - x, points[j, 1] - y)] = True
        if seen.sum() < MIN_SECTORS:
            continue
        for k in range(found):
            j = near[k]
            if part[j] >= 0 and points[j, 2] >= z + MIN_GAP and counted_last[part[j]] != i:
                counted_last[part[j]] = i
                counts[part[j]] += 1
