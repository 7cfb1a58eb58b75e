"""
Arcs round a point in which the centre of an empty disc that touches it may lie.

Every neighbour keeps the centre out of an arc. Arcs are first covered in sectors looked up by the neighbour's
place, which is quick and settles nearly all points; the others are cut exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel

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
