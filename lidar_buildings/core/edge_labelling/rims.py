"""
Thinning: of the band that clusters label along edges, the points on the rim stay.

"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.neighbourhoods import build_grid
from lidar_buildings.core.row_blocks import for_row_blocks

#: Points nearer than this part of the disc's radius are at the same place: which side they lie on is chance.
SAME_PLACE = 1e-6
#: What is left open by less than this is closed, so that points of a lattice tie everywhere or nowhere [rad].
TIE = 1e-6


def on_rims(
    points: NDArray[np.float64],
    band: NDArray[np.bool_],
    roof_id: NDArray[np.int64] | None,
    *,
    radius: float,
    reach: float,
    max_step: float = math.inf,
) -> NDArray[np.bool_]:
    """
    Tell which points near the band lie on a rim: an empty disc touches them in plan.

    That is Edelsbrunner's (1983) alpha-extreme point, found from the neighbours alone: each of them keeps the
    disc's centre out of an arc round the point, and what arcs leave open is room for a disc.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In any order [m].
    band : ndarray of bool, shape (n_points,)
        Points that an edge is near to.
    roof_id : ndarray of int64, shape (n_points,), or None
        Points of other roofs are not seen.
    radius : float
        Of the disc [m].
    reach : float
        How far from the band rims are looked for, in space [m]; 0 for the band alone.
    max_step : float
        Points farther up or down than this are not seen [m].

    """
    rim = np.zeros(len(points), dtype=np.bool_)
    if not band.any():
        return rim
    grid = build_grid(points, max(2.0 * radius, reach))
    near = band[grid.rows]
    roof = np.zeros(1, dtype=np.int64) if roof_id is None else roof_id[grid.rows]
    for_row_blocks(
        lambda begin, end: _find_rims(grid, near, roof, radius, reach, max_step, rim, begin, end), len(points)
    )
    return rim


@njit(cache=True, nogil=True)
def _find_rims(grid, band, roof, radius, reach, max_step, rim, begin, end):  # type: ignore[no-untyped-def]
    """
    Fill the rows of sorted points begin to end.

    """
    arcs = np.empty((64, 2))
    for i in range(begin, end):
        if not _is_near_band(grid, band, roof, reach, i):
            continue
        n_arcs, arcs = _blocked_arcs(grid, roof, radius, max_step, i, arcs)
        rim[grid.rows[i]] = _is_open(arcs[:n_arcs])


@njit(cache=True, nogil=True)
def _is_near_band(grid, band, roof, reach, i):  # type: ignore[no-untyped-def]
    """
    Whether sorted point i, or one of its roof within reach, is of the band.

    """
    if band[i]:
        return True
    points = grid.points
    for c in grid.adjacent[grid.cell[i]]:
        if c < 0:
            continue
        for j in range(grid.first[c], grid.first[c + 1]):
            if not band[j] or (len(roof) > 1 and roof[j] != roof[i]):
                continue
            dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            if dx * dx + dy * dy + dz * dz <= reach * reach:
                return True
    return False


@njit(cache=True, nogil=True)
def _blocked_arcs(grid, roof, radius, max_step, i, arcs):  # type: ignore[no-untyped-def]
    """
    Write the directions in which a neighbour of sorted point i lies within the disc; return how many.

    Arcs begin within ± π and end up to 2 π later; `arcs` is replaced by a longer one where it is full.

    """
    points = grid.points
    found = 0
    for c in grid.adjacent[grid.cell[i]]:
        if c < 0:
            continue
        for j in range(grid.first[c], grid.first[c + 1]):
            if len(roof) > 1 and roof[j] != roof[i]:
                continue
            dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            distance = math.sqrt(dx * dx + dy * dy)
            if distance >= 2.0 * radius or distance <= SAME_PLACE * radius or abs(dz) > max_step:
                continue
            if found == len(arcs):
                arcs = np.concatenate((arcs, np.empty_like(arcs)))
            half = math.acos(distance / (2.0 * radius))
            begin = math.atan2(dy, dx) - half
            arcs[found, 0] = begin + 2.0 * math.pi if begin < -math.pi else begin
            arcs[found, 1] = 2.0 * half
            found += 1
    return found, arcs


@njit(cache=True, nogil=True)
def _is_open(arcs):  # type: ignore[no-untyped-def]
    """
    Whether arcs, given by where they begin and how far they go, leave a part of the circle open.

    """
    if len(arcs) == 0:
        return True
    order = np.argsort(arcs[:, 0])
    start = arcs[order[0], 0]
    covered = start
    for k in order:
        if arcs[k, 0] > covered + TIE:
            return True
        covered = max(covered, arcs[k, 0] + arcs[k, 1])
    return covered < start + 2.0 * math.pi - TIE
