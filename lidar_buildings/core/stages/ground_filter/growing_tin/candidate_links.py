"""Which candidates are next to each other, the nearest one in each direction, and which are connected."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.columns import by_column
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.neighbours.sectors import N_SECTORS, sector_of
from lidar_buildings.core.neighbours.union_find import flatten, link

#: Rows a block of work; wide margin, the result does not depend on it.
ROWS_A_BLOCK = 1024


def nearest_by_sector(
    candidates: NDArray[np.float64], rows: NDArray[np.intp], reach: float
) -> NDArray[np.int32]:
    """
    Return for each of the rows the nearest other candidate in each of eight sectors, −1 where there is none.

    At most one candidate a place; none farther away in plan than `reach` [m].
    """
    cells = by_column(candidates, reach)
    found = np.full((len(rows), N_SECTORS), -1, dtype=np.int32)
    runs = cells.first[cells.around(reach)]
    cell = np.empty(len(candidates), dtype=np.int64)
    cell[cells.rows] = cells.column
    for_row_blocks(
        lambda a, b: _look_around(candidates, rows, cell, runs, cells.points, cells.rows, reach, found, a, b),
        len(rows),
        ROWS_A_BLOCK,
    )
    return found


@kernel
def level_parts(candidates, rows, links, max_slope):  # type: ignore[no-untyped-def]
    """
    Return the part of each row: the lowest of the rows that it is connected with.

    Neighbours, the `links` of `nearest_by_sector`, are connected if they rise by no more than `max_slope`
    over their distance.
    """
    place = np.full(len(candidates), -1, dtype=np.int32)
    part = np.empty(len(rows), dtype=np.int64)
    for r in range(len(rows)):
        place[rows[r]] = part[r] = r
    for r in range(len(rows)):
        for j in links[r]:
            if j < 0 or place[j] < 0:
                continue
            rise, length = rise_and_length(candidates[j], candidates[rows[r]])
            if abs(rise) <= max_slope * length:
                link(part, r, place[j])
    flatten(part)
    return part


@kernel
def rise_and_length(start, end):  # type: ignore[no-untyped-def]
    """Return the rise from one point to another and their distance in plan [m]."""
    return end[2] - start[2], math.hypot(end[0] - start[0], end[1] - start[1])


@kernel
def _look_around(candidates, rows, cell, runs, points, origin, reach, found, begin, end):  # type: ignore[no-untyped-def]
    """
    Fill the rows `begin` to `end` of `found`; `points` are the candidates by cell, `origin` their rows.

    `runs` say between which of them the cells around lie, south, level and north: (n_cells, 3, 2).
    """
    nearest = np.empty(N_SECTORS)
    for r in range(begin, end):
        x, y, k = candidates[rows[r], 0], candidates[rows[r], 1], cell[rows[r]]
        nearest[:] = reach * reach
        for line in range(3):
            for i in range(runs[k, line, 0], runs[k, line, 1]):
                dx, dy = points[i, 0] - x, points[i, 1] - y
                squared = dx * dx + dy * dy
                if squared == 0.0 or squared > reach * reach:
                    continue
                sector = sector_of(dx, dy)
                if squared < nearest[sector]:
                    nearest[sector] = squared
                    found[r, sector] = origin[i]
