"""Roofs in plan: what hangs together in square cells."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.cell_grid import CellGrid
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.neighbours.union_find import flatten, link
from lidar_buildings.core.neighbours.windows import first_windows, move_windows

#: Cells a block of work: some ten thousand points.
CELLS_A_BLOCK = 2048


def roofs_in_plan(cells: CellGrid) -> NDArray[np.int64]:
    """Number roofs from 0, per input row: points in cells that touch, be it at a corner, are of one."""
    parent = np.arange(len(cells.numbers))
    _link_neighbours(cells.numbers, cells.n_columns, parent)
    # The first cell of a roof is its root: roofs are numbered in the order of their first cells.
    number = (np.cumsum(parent == np.arange(len(parent))) - 1)[parent]
    roof = np.empty(len(cells.points), dtype=np.int64)
    for_row_blocks(lambda a, b: _spread(cells, number, roof, a, b), len(number), CELLS_A_BLOCK)
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


@njit(cache=True, nogil=True)
def _spread(cells, number, roof, begin, end):  # type: ignore[no-untyped-def]
    """Write the numbers of cells begin to end to the rows of their points."""
    for cell in range(begin, end):
        for i in range(cells.first[cell], cells.first[cell + 1]):
            roof[cells.rows[i]] = number[cell]
