"""
What is too narrow to be a building: hedges, balconies, walls; and vehicles, which are narrow as a whole.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

#: Cells along the side of the blocks in which the plan is handled, so that far points cost no memory.
BLOCK = 512
#: Cells that are empty by chance are closed if they are as few as this in a row.
CLOSING = np.ones((3, 3), dtype=bool)


def half_widths(points: NDArray[np.float64], cell: float, max_width: float) -> NDArray[np.float64]:
    """
    Return how far each point lies from the edge of what it belongs to, in plan.

    Cells that hold points, small gaps closed, make the plan; the distance is that from the middle of a cell
    to the edge of the nearest empty one.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        Of roofs, in any order [m].
    cell : float
        Side of the cells; no less than a spacing, else a roof is full of gaps [m].
    max_width : float
        Where something is wider, half of this or more is returned [m].

    Returns
    -------
    ndarray of shape (n_points,)
        To within half a cell [m]. The order of the points does not matter, nor what lies farther away
        than the width and some cells.
    """
    return _measured(points, cell, max_width, lambda plan: (to_edge(plan) - 0.5) * cell)


def wide_enough(points: NDArray[np.float64], cell: float, min_width: float) -> NDArray[np.bool_]:
    """
    Tell which points lie within a disc, of this diameter, that lies within the plan of the points.

    An opening: cells are cut back by half the width and grown again by as much, and by half a cell.

    Parameters
    ----------
    points, cell
        As for `half_widths`.
    min_width : float
        Diameter of the disc [m]; one below two cells says nothing, and all points pass.
    """
    if min_width < 2.0 * cell:
        return np.ones(len(points), dtype=bool)
    return _measured(points, cell, min_width, lambda plan: opened(to_edge(plan), min_width / cell) * 1.0) > 0


def opened(depth: NDArray[np.float64], width: float) -> NDArray[np.bool_]:
    """Tell which cells a disc within the plan covers: its diameter in cells, distances to the edge given."""
    core = depth >= width / 2.0
    return ndimage.distance_transform_edt(~core) <= width / 2.0 + 1.0 if core.any() else core


def _measured(points, cell, width, measure):  # type: ignore[no-untyped-def]
    """Return what `measure` makes of the plan at each point, block by block with a margin."""
    values = np.zeros(len(points))
    cells = np.floor(points[:, :2] / cell).astype(np.int64)
    blocks, block = np.unique(cells // BLOCK, axis=0, return_inverse=True)
    margin = math.ceil(2.0 * width / cell) + 3
    side = BLOCK + 2 * margin
    for number, corner in enumerate(blocks * BLOCK - margin):
        near = np.flatnonzero(((cells >= corner) & (cells < corner + side)).all(axis=1))
        plan = np.zeros((side, side), dtype=bool)
        plan[tuple((cells[near] - corner).T)] = True
        plan = closed(plan)
        own = near[block.ravel()[near] == number]
        values[own] = measure(plan)[tuple((cells[own] - corner).T)]
    return values


def closed(plan: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return a plan with cells filled that are empty by chance."""
    return plan | ndimage.binary_closing(plan, CLOSING)


def to_edge(plan: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return each cell's distance from the nearest empty one [cells]; the window's limits are no edges."""
    distance = ndimage.distance_transform_edt(np.pad(plan, 1, mode="edge"))[1:-1, 1:-1]
    return np.asarray(distance, dtype=np.float64)
