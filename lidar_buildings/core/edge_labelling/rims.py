"""
Thinning: of the band that clusters label along edges, the points on the rim stay.

"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.edge_labelling.plan_cells import PlanCells
from lidar_buildings.core.row_blocks import for_row_blocks

#: Points nearer than this part of the disc's radius are at the same place: which side they lie on is chance.
SAME_PLACE = 1e-6
#: What is left open by less than this part of a quarter turn is closed, so that points of a lattice tie
#: everywhere or nowhere.
TIE = 1e-6
#: Open arcs that are kept apart; a point with more of them is surely on a rim.
MAX_OPEN = 128
#: Cells a block of work: some ten thousand points.
CELLS_A_BLOCK = 1024
#: A full turn, see `_direction`.
TURN = 4.0


def on_rims(
    cells: PlanCells,
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
    cells : PlanCells
        The points, in cells no smaller than twice the radius and than the reach.
    band : ndarray of bool, shape (n_points,)
        Points that an edge is near to, per input row.
    roof_id : ndarray of int64, shape (n_points,), or None
        Points of other roofs are not seen.
    radius : float
        Of the disc [m].
    reach : float
        How far from the band in plan rims are looked for [m]; 0 for the band alone.
    max_step : float
        Points farther up or down than this are not seen [m].

    Returns
    -------
    ndarray of bool, shape (n_points,)
        Per input row.

    """
    rim = np.zeros(len(band), dtype=np.bool_)
    in_band = np.flatnonzero(band[cells.rows])
    first = np.searchsorted(in_band, cells.first)
    roof = np.zeros(0, dtype=np.int64) if roof_id is None else roof_id[cells.rows]
    lengths = (radius, reach, max_step)
    for_row_blocks(
        lambda begin, end: _find_rims(cells, in_band, first, roof, lengths, rim, begin, end),
        len(cells.around),
        CELLS_A_BLOCK,
    )
    return rim


@njit(cache=True, nogil=True)
def _find_rims(cells, in_band, first, roof, lengths, rim, begin, end):  # type: ignore[no-untyped-def]
    """
    Fill the rows of the points of cells begin to end; in_band[first[k]] is cell k's first point of the band.

    """
    radius, reach, max_step = lengths
    arcs = np.empty((MAX_OPEN, 2))
    for cell in range(begin, end):
        around = cells.around[cell]
        is_near = False
        for c in around:
            is_near |= c >= 0 and first[c + 1] > first[c]
        if not is_near:
            continue
        for i in range(cells.first[cell], cells.first[cell + 1]):
            if _is_near_band(cells, around, in_band, first, roof, reach, max_step, i):
                rim[cells.rows[i]] = _is_touched(cells, around, roof, radius, max_step, i, arcs)


@njit(cache=True, nogil=True)
def _is_near_band(cells, around, in_band, first, roof, reach, max_step, i):  # type: ignore[no-untyped-def]
    """
    Whether sorted point i, or one of its roof within reach, is of the band.

    """
    x, y, z = cells.points[i]
    for c in around:
        if c < 0:
            continue
        for k in range(first[c], first[c + 1]):
            j = in_band[k]
            if len(roof) > 0 and roof[j] != roof[i]:
                continue
            dx, dy, dz = cells.points[j, 0] - x, cells.points[j, 1] - y, cells.points[j, 2] - z
            if dx * dx + dy * dy <= reach * reach and abs(dz) <= max_step:
                return True
    return False


@njit(cache=True, nogil=True)
def _is_touched(cells, around, roof, radius, max_step, i, arcs):  # type: ignore[no-untyped-def]
    """
    Whether an empty disc touches sorted point i; `arcs` is room to work in.

    """
    x, y, z = cells.points[i]
    arcs[0] = 0.0, TURN
    n_open = 1
    for c in around:
        if c < 0:
            continue
        for j in range(cells.first[c], cells.first[c + 1]):
            if len(roof) > 0 and roof[j] != roof[i]:
                continue
            dx, dy, dz = cells.points[j, 0] - x, cells.points[j, 1] - y, cells.points[j, 2] - z
            square = dx * dx + dy * dy
            if square >= 4.0 * radius * radius or abs(dz) > max_step:
                continue
            if square <= (SAME_PLACE * radius) ** 2:
                continue
            first, last = _blocked(dx, dy, math.sqrt(square), math.sqrt(4.0 * radius * radius - square))
            n_open = _without(arcs, n_open, first, TURN if last < first else last)
            if last < first:
                n_open = _without(arcs, n_open, 0.0, last)
            if n_open == 0:
                return False
    return True


@njit(cache=True, nogil=True)
def _blocked(dx, dy, distance, across):  # type: ignore[no-untyped-def]
    """
    Return where the arc begins and ends in which a neighbour keeps the disc's centre out.

    The disc's diameter is the hypotenuse of the neighbour's distance and `across`: from the neighbour's
    direction (dx, dy) to either end the arc goes by the angle between diameter and distance.

    """
    first = _direction(dx * distance + dy * across, dy * distance - dx * across)
    return first, _direction(dx * distance - dy * across, dy * distance + dx * across)


@njit(cache=True, nogil=True)
def _direction(east, north):  # type: ignore[no-untyped-def]
    """
    Return a number from 0 to 4 that rises with a vector's direction, anticlockwise from the east.

    Quarter turns that are not quite even: it saves the arc tangent.

    """
    along = north / (abs(east) + abs(north))
    if east < 0.0:
        return 2.0 - along
    return along if along >= 0.0 else 4.0 + along


@njit(cache=True, nogil=True)
def _without(arcs, n_open, first, last):  # type: ignore[no-untyped-def]
    """
    Take the arc first to last out of the open ones; return how many are left.

    """
    k = 0
    while k < n_open:
        begin, end = arcs[k]
        has_before, has_after = first - begin > TIE, end - last > TIE
        if end <= first or begin >= last:
            k += 1
        elif has_before:
            arcs[k, 1] = first
            if has_after and n_open < MAX_OPEN:
                # Put at the end, where it is met again and left alone.
                arcs[n_open] = last, end
                n_open += 1
            k += 1
        elif has_after:
            arcs[k, 0] = last
            k += 1
        else:
            n_open -= 1
            arcs[k] = arcs[n_open]
    return n_open
