"""Façades: what of a building lies below the edges of its roofs, and between them."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.neighbourhoods import build_grid, neighbours_of
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.stages.roof_selection.sectors import N_SECTORS, sector_of

#: A façade lies within this many spacings of its roof's points in plan: an edge is missed by half a spacing.
REACH_SPACINGS = 0.7
#: How far in plan to look for the top of the wall [m].
TOP_REACH = 1.0
#: How far a façade has to lie below that [m].
MIN_DROP = 0.3
#: How far in plan to look for roof around a light well or a dormer's cheek [m], and the sectors of eight that
#: have to show some: one at a straight edge sees it in five.
WELL_REACH = 2.0
MIN_SECTORS = 6
#: Lowest point of a façade above ground; below it is pavement and planting [m].
MIN_HEIGHT = 0.8


def find_facades(
    points: NDArray[np.float64],
    height: NDArray[np.float64],
    is_roof: NDArray[np.bool_],
    is_open: NDArray[np.bool_],
    is_last: NDArray[np.bool_],
    reach: float,
    spacing: float,
) -> NDArray[np.bool_]:
    """
    Tell which points hang below a roof's edge: walls, windows, what is under the eaves; and in light wells.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In any order [m].
    height : ndarray of shape (n_points,)
        Above ground [m].
    is_roof : ndarray of bool, shape (n_points,)
        Which points are roof; the answer for them is False.
    is_open : ndarray of bool, shape (n_points,)
        Which points can be façade: neither ground nor of a class that stays.
    is_last : ndarray of bool, shape (n_points,)
        Whether the pulse ended there; what has roof all around counts only then, else it is foliage.
    reach : float
        Largest distance from a roof point in plan [m]; 0 for none. It is no less than 0.7 spacings.
    spacing : float
        Spacing of the pulses [m].
    """
    found = np.zeros(len(points), dtype=bool)
    rows = np.flatnonzero(is_roof | (is_open & (height >= MIN_HEIGHT)))
    if reach <= 0.0 or not is_roof.any():
        return found
    reach = max(reach, REACH_SPACINGS * spacing)
    around = max(WELL_REACH, reach)
    grid = build_grid(points[rows], around)
    roof, last, hangs = is_roof[rows], is_last[rows], np.zeros(len(rows), dtype=bool)
    for_row_blocks(lambda begin, end: _hang(grid, roof, last, reach, around, hangs, begin, end), len(rows))
    found[rows] = hangs
    return found


@njit(cache=True, nogil=True)
def _hang(grid, is_roof, is_last, reach, around, hangs, begin, end):  # type: ignore[no-untyped-def]
    points = grid.points
    near = np.empty(len(points), dtype=np.int64)
    seen = np.zeros(N_SECTORS, dtype=np.bool_)
    for i in range(begin, end):
        row = grid.rows[i]
        if is_roof[row]:
            continue
        x, y, z = points[i]
        is_near, top, highest = False, -np.inf, -np.inf
        seen[:] = False
        for k in range(neighbours_of(grid, grid.cell[i], x, y, z, around, True, near)):
            if not is_roof[grid.rows[near[k]]]:
                continue
            dx, dy, other = points[near[k], 0] - x, points[near[k], 1] - y, points[near[k], 2]
            square = dx * dx + dy * dy
            is_near = is_near or square <= reach * reach
            if square <= TOP_REACH * TOP_REACH:
                top = max(top, other)
            highest = max(highest, other)
            seen[sector_of(dx, dy)] = True
        is_well = is_last[row] and seen.sum() >= MIN_SECTORS and z <= highest
        hangs[row] = is_well or (is_near and z <= top - MIN_DROP)
