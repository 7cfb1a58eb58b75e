"""Thinning: of the band that clusters label along edges, the points on the rim stay."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.neighbours.cell_grid import CellGrid
from lidar_buildings.core.neighbours.parallel import for_row_blocks

#: Points nearer than this part of the disc's radius are at the same place: which side they lie on is chance.
SAME_PLACE = 1e-6
#: What is left open by less than this part of a quarter turn is closed, so that points of a lattice tie
#: everywhere or nowhere.
TIE = 1e-6
#: Open arcs that are kept apart; a point with more of them is surely on a rim.
MAX_OPEN = 128
#: A full turn, see `_direction`.
TURN = 4.0
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
    disc's centre out of an arc round the point, and the arcs left open have room for a disc. `cells` hold the
    points, in cells no smaller than twice the `radius` of the disc and than the `reach`, how far from the
    `band` in plan rims are looked for [m]. Points of other roofs, if a `roof_id` is given, and farther up or
    down than `max_step` [m] are ignored. Rows are those of the input.
    """
    rim = np.zeros(len(band), dtype=np.bool_)
    roof = np.zeros(len(band), dtype=np.int64) if roof_id is None else roof_id[cells.rows]
    in_band, runs = band[cells.rows], cells.first[cells.around(cells.size)]
    for_row_blocks(
        lambda begin, end: _find_rims(cells, runs, roof, in_band, radius, reach, max_step, rim, begin, end),
        len(cells.numbers),
        CELLS_A_BLOCK,
    )
    return rim


@kernel
def _find_rims(cells, around, roof, in_band, radius, reach, max_step, rim, begin, end):  # type: ignore[no-untyped-def]
    """Fill the rows of the points of cells begin to end."""
    arcs = np.empty((MAX_OPEN, 2))
    for cell in range(begin, end):
        runs = around[cell]
        for i in range(cells.first[cell], cells.first[cell + 1]):
            if _is_near(cells.points, roof, in_band, i, runs, reach, max_step):
                rim[cells.rows[i]] = _is_touched(cells.points, roof, i, runs, radius, max_step, arcs)


@kernel
def _is_near(points, roof, in_band, i, runs, reach, max_step):  # type: ignore[no-untyped-def]
    """Whether a point of the band, of the same roof, is within reach of point i."""
    for begin, end in runs:
        for j in range(begin, end):
            dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            if (
                in_band[j]
                and dx * dx + dy * dy <= reach * reach
                and abs(dz) <= max_step
                and roof[j] == roof[i]
            ):
                return True
    return False


@kernel
def _is_touched(points, roof, i, runs, radius, max_step, arcs):  # type: ignore[no-untyped-def]
    """Whether an empty disc touches point i: the arcs that neighbours block are cut out one by one."""
    arcs[0, 0], arcs[0, 1] = 0.0, TURN
    n_open, diameter, same = np.int64(1), 2.0 * radius, (SAME_PLACE * radius) ** 2
    for begin, end in runs:
        for j in range(begin, end):
            dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            square = dx * dx + dy * dy
            if same < square < diameter * diameter and abs(dz) <= max_step and roof[j] == roof[i]:
                n_open = _without_neighbour(arcs, n_open, dx, dy, diameter)
                if n_open == 0:
                    return False
    return True


@kernel
def _without_neighbour(arcs, n_open, dx, dy, diameter):  # type: ignore[no-untyped-def]
    """Take the arc that a neighbour blocks out of the open ones; return how many are left."""
    square = dx * dx + dy * dy
    first, last = _blocked(dx, dy, math.sqrt(square), math.sqrt(diameter * diameter - square))
    n_open = _without(arcs, n_open, first, TURN if last < first else last)
    if last < first:
        n_open = _without(arcs, n_open, 0.0, last)
    return n_open


@kernel
def _blocked(dx, dy, distance, across):  # type: ignore[no-untyped-def]
    """Return where the arc begins and ends in which a neighbour keeps the disc's centre out."""
    # The disc's diameter is the hypotenuse of the neighbour's distance and `across`: from the neighbour's
    # direction (dx, dy) to either end the arc goes by the angle between diameter and distance.
    first = _direction(dx * distance + dy * across, dy * distance - dx * across)
    return first, _direction(dx * distance - dy * across, dy * distance + dx * across)


@inner_kernel
def _direction(east, north):  # type: ignore[no-untyped-def]
    """Return a number from 0 to 4 that rises with a vector's direction, anticlockwise from the east."""
    # Quarter turns that are not quite even: it saves the arc tangent.
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
