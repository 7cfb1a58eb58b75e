"""What lies around each point: a surface it continues, roof on all sides, roof above, foliage."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.neighbourhoods import build_grid, neighbours_of
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.stages.roof_selection.sectors import N_SECTORS, sector_of

#: Points more nearly on a line than this span no plane: cables, single scan lines.
MAX_LINEARITY = 0.95
#: Sectors of eight that have to show roof: a part at a straight roof edge sees it in five.
MIN_SECTORS = 6


def near_tangent_plane(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    is_surface: NDArray[np.bool_],
    radius: float,
    max_distance: float,
) -> NDArray[np.bool_]:
    """
    Tell which points lie on the surface or its immediate continuation.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In any order [m].
    normals : ndarray of shape (n_points, 3)
        Unit normals of the surface points; others are not looked at.
    is_surface : ndarray of bool, shape (n_points,)
        Which points are surface.
    radius : float
        How far the surface goes on beyond its points [m].
    max_distance : float
        Largest distance from the tangent plane of a surface point within the radius [m].

    Returns
    -------
    ndarray of bool, shape (n_points,)
        True for surface points and what continues them.
    """
    grid = build_grid(points, radius)
    joined = is_surface.copy()
    for_row_blocks(
        lambda begin, end: _near_plane(grid, normals, is_surface, radius, max_distance, joined, begin, end),
        len(points),
    )
    return joined


def surrounded_by(
    points: NDArray[np.float64],
    is_roof: NDArray[np.bool_],
    radius: float,
    max_below: float,
    max_above: float,
) -> NDArray[np.bool_]:
    """
    Tell which points stand on a roof: roof all around in plan, and at about its height.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In any order [m].
    is_roof : ndarray of bool, shape (n_points,)
        Which points are roof; the answer for them is False.
    radius : float
        How far to look in plan [m].
    max_below, max_above : float
        How far a point may lie below the lowest and above the highest of the roof points around it [m].
    """
    grid = build_grid(points, radius)
    held = np.zeros(len(points), dtype=bool)
    for_row_blocks(
        lambda begin, end: _surrounded(grid, is_roof, radius, max_below, max_above, held, begin, end),
        len(points),
    )
    return held


def share_around(points: NDArray[np.float64], flag: NDArray[np.bool_], radius: float) -> NDArray[np.float64]:
    """Return the share of flagged points within a radius of each point."""
    grid = build_grid(points, radius)
    share = np.zeros(len(points))
    for_row_blocks(lambda begin, end: _share(grid, flag, radius, share, begin, end), len(points))
    return share


def below_roof(points: NDArray[np.float64], is_roof: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    """Tell which points have a roof point above them within a radius in plan [m]."""
    grid = build_grid(points, radius)
    below = np.zeros(len(points), dtype=bool)
    for_row_blocks(lambda begin, end: _below(grid, is_roof, radius, below, begin, end), len(points))
    return below


@njit(cache=True, nogil=True)
def _near_plane(grid, normals, is_surface, radius, max_distance, joined, begin, end):  # type: ignore[no-untyped-def]
    near = np.empty(len(grid.points), dtype=np.int64)
    for i in range(begin, end):
        row = grid.rows[i]
        if is_surface[row]:
            continue
        x, y, z = grid.points[i]
        for k in range(neighbours_of(grid, grid.cell[i], x, y, z, radius, False, near)):
            other = grid.rows[near[k]]
            if not is_surface[other]:
                continue
            p = grid.points[near[k]]
            a, b, c = normals[other]
            if abs(a * (x - p[0]) + b * (y - p[1]) + c * (z - p[2])) <= max_distance:
                joined[row] = True
                break


@njit(cache=True, nogil=True)
def _surrounded(grid, is_roof, radius, max_below, max_above, held, begin, end):  # type: ignore[no-untyped-def]
    near = np.empty(len(grid.points), dtype=np.int64)
    seen = np.zeros(N_SECTORS, dtype=np.bool_)
    for i in range(begin, end):
        row = grid.rows[i]
        if is_roof[row]:
            continue
        x, y, z = grid.points[i]
        seen[:] = False
        lowest, highest = np.inf, -np.inf
        for k in range(neighbours_of(grid, grid.cell[i], x, y, z, radius, True, near)):
            if not is_roof[grid.rows[near[k]]]:
                continue
            p = grid.points[near[k]]
            seen[sector_of(p[0] - x, p[1] - y)] = True
            lowest, highest = min(lowest, p[2]), max(highest, p[2])
        held[row] = seen.sum() >= MIN_SECTORS and lowest - max_below <= z <= highest + max_above


@njit(cache=True, nogil=True)
def _share(grid, flag, radius, share, begin, end):  # type: ignore[no-untyped-def]
    near = np.empty(len(grid.points), dtype=np.int64)
    for i in range(begin, end):
        x, y, z = grid.points[i]
        found = neighbours_of(grid, grid.cell[i], x, y, z, radius, False, near)
        flagged = 0
        for k in range(found):
            flagged += flag[grid.rows[near[k]]]
        share[grid.rows[i]] = flagged / found


@njit(cache=True, nogil=True)
def _below(grid, is_roof, radius, below, begin, end):  # type: ignore[no-untyped-def]
    near = np.empty(len(grid.points), dtype=np.int64)
    for i in range(begin, end):
        x, y, z = grid.points[i]
        if is_roof[grid.rows[i]]:
            continue
        for k in range(neighbours_of(grid, grid.cell[i], x, y, z, radius, True, near)):
            if is_roof[grid.rows[near[k]]] and grid.points[near[k], 2] >= z:
                below[grid.rows[i]] = True
                break
