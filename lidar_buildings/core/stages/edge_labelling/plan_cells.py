"""Roofs in plan: what hangs together in square cells."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.cell_grid import CellGrid
from lidar_buildings.core.neighbours.union_find import flatten, link
from lidar_buildings.core.neighbours.windows import first_windows, move_windows


def roofs_in_plan(cells: CellGrid) -> NDArray[np.int64]:
    """Number roofs from 0, per input row: points in cells that touch, be it at a corner, are of one."""
    parent = np.arange(len(cells.numbers))
    _link_neighbours(cells.numbers, cells.n_columns, parent)
    # The first cell of a roof is its root: roofs are numbered in the order of their first cells.
    number = (np.cumsum(parent == np.arange(len(parent))) - 1)[parent]
    roof = np.empty(len(cells.points), dtype=np.int64)
    roof[cells.rows] = np.repeat(number, np.diff(cells.first))
    return roof


@njit(cache=True, nogil=True)
def _link_neighbours(numbers, n_columns, parent):  # type: ignore[no-untyped-def]
    """Link every cell to those round it, of which those before it are enough."""
    if len(numbers) == 0:
        return
    windows = first_windows(numbers, n_columns, 1, 0)
    for cell in range(len(numbers)):
        move_windows(numbers, n_columns, 1, cell, windows)
        for row in range(2):
            for other in range(windows[row, 0], min(windows[row, 1], cell)):
                link(parent, cell, other)
    flatten(parent)
