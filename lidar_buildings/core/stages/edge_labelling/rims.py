"""Thinning: of the band that clusters label along edges, the points on the rim stay."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import CellGrid
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.neighbours.windows import first_windows, move_windows
from lidar_buildings.core.stages.edge_labelling.clusters import numbered

#: Points nearer than this part of the disc's radius are at the same place: which side they lie on is chance.
SAME_PLACE = 1e-6
#: What is gathered of a neighbour: x, y, z, roof; and room for the number of its square.
N_COLUMNS = 5
#: Cells a block of work: some ten thousand points.
CELLS_A_BLOCK = 2048


def on_rims(
    cells: CellGrid,
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
    cells : CellGrid
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
    roof = np.zeros(len(band), dtype=np.int64) if roof_id is None else numbered(roof_id)[1][cells.rows]
    in_band = np.flatnonzero(band[cells.rows])
    band_first = np.searchsorted(in_band, cells.first)
    everything = (cells.points, roof, cells.first)
    of_band = (cells.points[in_band], roof[in_band], band_first)
    lengths, table = (radius, reach, max_step), sector_table()
    for_row_blocks(
        lambda begin, end: _find_rims(cells, everything, of_band, lengths, table, rim, begin, end),
        len(cells.numbers),
        CELLS_A_BLOCK,
    )
    return rim


@kernel
def _find_rims(cells, everything, of_band, lengths, table, rim, begin, end):  # type: ignore[no-untyped-def]
    """
    Fill the rows of the points of cells begin to end.

    `everything` and `of_band` are points, their roofs, and where those of each cell begin.
    """
    points, roof, first = everything
    radius, reach, max_step = lengths
    arcs = np.empty((MAX_OPEN, 2))
    near = band = np.empty((N_COLUMNS, 0))
    windows = first_windows(cells.numbers, cells.n_columns, 1, begin)
    for cell in range(begin, end):
        move_windows(cells.numbers, cells.n_columns, 1, cell, windows)
        band, n_band = _gathered(of_band, windows, band)
        if n_band == 0:
            continue
        near, n_near = _gathered(everything, windows, near)
        for i in range(first[cell], first[cell + 1]):
            place = (points[i, 0], points[i, 1], points[i, 2], float(roof[i]))
            if _is_near(band, n_band, place, reach, max_step):
                rim[cells.rows[i]] = _is_on_rim(near, n_near, place, radius, max_step, table, arcs)


@kernel
def _gathered(sorted_points, windows, near):  # type: ignore[no-untyped-def]
    """
    Write x, y, z and roof of the points in a window of cells to the rows of `near`, or of larger ones.

    Returns
    -------
    near : ndarray of shape (N_COLUMNS, at least n_near)
        What is beyond the last point is rubbish.
    n_near : int
        How many points there are.
    """
    points, roof, first = sorted_points
    n_near = 0
    for begin, end in windows:
        n_near += first[end] - first[begin]
    if n_near > near.shape[1]:
        near = np.empty((N_COLUMNS, 2 * n_near))
    k = 0
    for begin, end in windows:
        for j in range(first[begin], first[end]):
            near[0, k], near[1, k], near[2, k] = points[j, 0], points[j, 1], points[j, 2]
            near[3, k] = roof[j]
            k += 1
    return near, n_near


@kernel
def _is_near(band, n_band, place, reach, max_step):  # type: ignore[no-untyped-def]
    """Whether one of the first points of the band, of the same roof, is within reach of a place."""
    x, y, z, roof = place
    found = False
    for j in range(n_band):
        dx, dy, dz = band[0, j] - x, band[1, j] - y, band[2, j] - z
        # No branch, so that it becomes a vector instruction.
        found |= (dx * dx + dy * dy <= reach * reach) & (abs(dz) <= max_step) & (band[3, j] == roof)
    return found


@kernel
def _is_on_rim(near, n_near, place, radius, max_step, table, arcs):  # type: ignore[no-untyped-def]
    """Whether an empty disc touches a place: by sectors if they suffice, else by arcs."""
    x, y, z, roof = place
    scale, same = N_SQUARES / (4.0 * radius), (SAME_PLACE * radius) ** 2
    squares = near[4]
    for j in range(n_near):
        dx, dy, dz = near[0, j] - x, near[1, j] - y, near[2, j] - z
        seen = (abs(dz) <= max_step) & (near[3, j] == roof) & (dx * dx + dy * dy > same)
        squares[j] = square_at(dx * scale, dy * scale) if seen else 0.0
    surely, perhaps = np.uint64(0), np.uint64(0)
    for j in range(n_near):
        square = int(squares[j])
        surely |= table[square, 0]
        perhaps |= table[square, 1]
    if surely == ALL_SECTORS:
        return False
    return perhaps != ALL_SECTORS or _is_touched(near, n_near, place, radius, max_step, arcs)


@kernel
def _is_touched(near, n_near, place, radius, max_step, arcs):  # type: ignore[no-untyped-def]
    """Return the same by cutting out arc after arc."""
    x, y, z, roof = place
    arcs[0, 0], arcs[0, 1] = 0.0, TURN
    n_open = 1
    for j in range(n_near):
        dx, dy, dz = near[0, j] - x, near[1, j] - y, near[2, j] - z
        square = dx * dx + dy * dy
        if square >= 4.0 * radius * radius or abs(dz) > max_step or near[3, j] != roof:
            continue
        if square <= (SAME_PLACE * radius) ** 2:
            continue
        n_open = without_neighbour(arcs, n_open, dx, dy, 2.0 * radius)
        if n_open == 0:
            return False
    return True


#: What is left open by less than this part of a quarter turn is closed, so that points of a lattice tie
#: everywhere or nowhere.
TIE = 1e-6
#: Open arcs that are kept apart; a point with more of them is surely on a rim.
MAX_OPEN = 128
#: A full turn, see `_direction`.
TURN = 4.0
#: Sectors of a full turn, one for each bit of a word.
N_SECTORS = 64
#: All of them.
ALL_SECTORS = np.uint64(2**64 - 1)
#: Squares across the disc's two diameters in which neighbours' places are looked up; even, so that no square
#: lies across the point itself.
N_SQUARES = 60
#: Discs are taken smaller by this part when sectors are looked up: far more than rounding could move a
#: neighbour, and what is missed is found exactly.
MARGIN = 1e-6


@lru_cache(maxsize=1)
def sector_table() -> NDArray[np.uint64]:
    """
    Return the sectors from which a neighbour keeps the disc's centre out, by the square that it lies in.

    It does so in the directions in which it lies in the disc itself. Discs are convex: all places of a square
    do if its corners do, and in all directions of a sector if in the first and the last one. None does in any
    direction if the square is farther from the sector's middle disc than the radius and a half sector's arc.

    Returns
    -------
    ndarray of uint64, shape ((N_SQUARES + 2)², 2)
        A bit for each sector: surely blocked, perhaps blocked. Squares row by row from the south-west, with a
        rim of those that are too far off.
    """
    edges = (np.arange(N_SQUARES + 1) - N_SQUARES // 2) * (4.0 / N_SQUARES)
    turn = np.pi / N_SECTORS * np.arange(2 * N_SECTORS + 1)
    corners = _squares_off(edges, turn[::2], np.subtract) <= (1.0 - MARGIN) ** 2
    corners = corners[1:] & corners[:-1]
    corners = corners[:, 1:] & corners[:, :-1]
    nearest = _squares_off(edges, turn[1::2], _gap) <= (1.0 + np.pi / N_SECTORS + MARGIN) ** 2
    bits = np.uint64(1) << np.arange(N_SECTORS, dtype=np.uint64)
    table = np.zeros((N_SQUARES + 2, N_SQUARES + 2, 2), dtype=np.uint64)
    for k, blocked in enumerate([corners[..., 1:] & corners[..., :-1], nearest]):
        table[1:-1, 1:-1, k] = np.where(blocked, bits, np.uint64(0)).sum(axis=2, dtype=np.uint64)
    return table.reshape(-1, 2)


def _squares_off(edges: NDArray[Any], turn: NDArray[Any], off: Callable[..., NDArray[Any]]) -> NDArray[Any]:
    """Return squared distances of squares or corners from the disc's centre in each direction."""
    east, north = off(edges[:, None], np.cos(turn)), off(edges[:, None], np.sin(turn))
    return np.square(north)[:, None] + np.square(east)[None]


def _gap(edges: NDArray[Any], place: NDArray[Any]) -> NDArray[Any]:
    """Return how far a place is from the interval between one edge and the next."""
    return np.maximum(np.maximum(edges[:-1] - place, place - edges[1:]), 0.0)


@kernel
def square_at(east, north):  # type: ignore[no-untyped-def]
    """Return the number of the square at a place in units of squares; 0 is too far off."""
    column = min(max(np.floor(east) + (N_SQUARES // 2 + 1.0), 0.0), N_SQUARES + 1.0)
    row = min(max(np.floor(north) + (N_SQUARES // 2 + 1.0), 0.0), N_SQUARES + 1.0)
    return row * (N_SQUARES + 2.0) + column


@kernel
def without_neighbour(arcs, n_open, dx, dy, diameter):  # type: ignore[no-untyped-def]
    """Take the arc that a neighbour blocks out of the open ones; return how many are left."""
    square = dx * dx + dy * dy
    first, last = _blocked(dx, dy, math.sqrt(square), math.sqrt(diameter * diameter - square))
    n_open = _without(arcs, n_open, first, TURN if last < first else last)
    if last < first:
        n_open = _without(arcs, n_open, 0.0, last)
    return n_open


@kernel
def _blocked(dx, dy, distance, across):  # type: ignore[no-untyped-def]
    """
    Return where the arc begins and ends in which a neighbour keeps the disc's centre out.

    The disc's diameter is the hypotenuse of the neighbour's distance and `across`: from the neighbour's
    direction (dx, dy) to either end the arc goes by the angle between diameter and distance.
    """
    first = _direction(dx * distance + dy * across, dy * distance - dx * across)
    return first, _direction(dx * distance - dy * across, dy * distance + dx * across)


@kernel
def _direction(east, north):  # type: ignore[no-untyped-def]
    """
    Return a number from 0 to 4 that rises with a vector's direction, anticlockwise from the east.

    Quarter turns that are not quite even: it saves the arc tangent.
    """
    along = north / (abs(east) + abs(north))
    if east < 0.0:
        return 2.0 - along
    return along if along >= 0.0 else 4.0 + along


@kernel
def _without(arcs, n_open, first, last):  # type: ignore[no-untyped-def]
    """Take the arc first to last out of the open ones; return how many are left."""
    k = 0
    while k < n_open:
        begin, end = arcs[k, 0], arcs[k, 1]
        has_before, has_after = first - begin > TIE, end - last > TIE
        if end <= first or begin >= last:
            k += 1
        elif has_before:
            arcs[k, 1] = first
            if has_after and n_open < MAX_OPEN:
                # Put at the end, where it is met again and left alone.
                arcs[n_open, 0], arcs[n_open, 1] = last, end
                n_open += 1
            k += 1
        elif has_after:
            arcs[k, 0] = last
            k += 1
        else:
            n_open -= 1
            arcs[k, 0], arcs[k, 1] = arcs[n_open, 0], arcs[n_open, 1]
    return n_open
