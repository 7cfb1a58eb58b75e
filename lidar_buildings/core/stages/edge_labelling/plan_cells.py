"""Roofs in plan: what hangs together in square cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.cell_grid import CellGrid
from lidar_buildings.core.neighbours.union_find import sets_of_pairs

#: Steps north and east to half of the cells round one; the others see it among theirs.
_BESIDE = ((0, 1), (1, -1), (1, 0), (1, 1))


def roofs_in_plan(cells: CellGrid) -> NDArray[np.int64]:
    """Number roofs from 0, per input row: points in cells that touch, be it at a corner, are of one."""
    n = len(cells.numbers)
    column, pairs = cells.numbers % cells.n_columns, []
    for north, east in _BESIDE:
        wanted = cells.numbers + (north * cells.n_columns + east)
        place = np.minimum(np.searchsorted(cells.numbers, wanted), n - 1)
        is_there = (column + east >= 0) & (column + east < cells.n_columns)
        one = np.flatnonzero(is_there & (cells.numbers[place] == wanted))
        pairs.append((one, place[one]))
    parent = sets_of_pairs(n, *(np.concatenate(ends) for ends in zip(*pairs, strict=True)))
    # The first cell of a roof is its root: roofs are numbered in the order of their first cells.
    number = (np.cumsum(parent == np.arange(n)) - 1)[parent]
    roof = np.empty(len(cells.points), dtype=np.int64)
    roof[cells.rows] = np.repeat(number, np.diff(cells.first))
    return roof
