"""
What is too narrow to be a building: hedges, balconies, walls; and vehicles, which are narrow as a whole.

Widths are measured in the plan of the columns that hold points, small gaps closed.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.columns import Columns
from lidar_buildings.core.surfaces.morphology import square_distances

#: Cells across the narrowest part: a disc of fewer is too coarse to tell what is as wide.
MIN_CELLS = 5.0
#: Cells along the side of the blocks in which the plan is handled, so that far points cost no memory.
BLOCK = 512


def half_widths(columns: Columns, max_width: float) -> NDArray[np.float64]:
    """
    Return how far the middle of each column lies from the edge of what its points belong to, in plan.

    Parameters
    ----------
    columns : Columns
        Of points of roofs; no narrower than a spacing, else a roof is full of gaps [m].
    max_width : float
        Where something is wider, half of this or more is returned [m].

    Returns
    -------
    ndarray of shape (n_columns,)
        To within half a column [m]. What lies farther away than the width and some columns does not matter.
    """
    size = columns.size
    reach = math.ceil(0.5 * max_width / size + 0.5)
    return _measured(columns, reach, lambda depth: np.sqrt(depth) * size) - 0.5 * size


def wide_enough(columns: Columns, min_width: float) -> NDArray[np.bool_]:
    """
    Tell which columns lie within a disc, of this diameter, that lies within the plan of the points.

    An opening: the plan is cut back by half the width and grown again by as much, and by half a column.

    Parameters
    ----------
    columns : Columns
        As for `half_widths`.
    min_width : float
        Diameter of the disc [m]; one below `MIN_CELLS` columns says nothing, and all pass.
    """
    half = 0.5 * min_width / columns.size
    if half < 0.5 * MIN_CELLS:
        return np.ones(len(columns.numbers), dtype=bool)
    return _measured(columns, math.ceil(half), lambda depth: opened(depth, half)) > 0


def _measured(
    columns: Columns, reach: int, measure: Callable[[NDArray[np.int32]], NDArray[np.generic]]
) -> NDArray[np.float64]:
    """Return what `measure` makes of the squared depth at each column, block by block with a margin."""
    values = np.zeros(len(columns.numbers))
    holds = np.flatnonzero(np.diff(columns.first))
    line, place = np.ascontiguousarray(columns.places[holds].T)
    margin = 2 * reach + 4
    band = line // BLOCK
    for north in band[np.flatnonzero(np.diff(band, prepend=-1))] * BLOCK:
        begin, end = np.searchsorted(line, (north - margin, north + BLOCK + margin))
        for east in np.unique(place[begin:end] // BLOCK) * BLOCK:
            near = (place[begin:end] >= east - margin) & (place[begin:end] < east + BLOCK + margin)
            y, x = line[begin:end][near], place[begin:end][near]
            south, west = y.min() - 2, x.min() - 2
            plan = np.zeros((y.max() + 3 - south, x.max() + 3 - west), dtype=np.uint8)
            plan[y - south, x - west] = 1
            measured = measure(square_distances(closed(plan), 0, reach))[y - south, x - west]
            own = (y >= north) & (y < north + BLOCK) & (x >= east) & (x < east + BLOCK)
            values[holds[begin:end][near][own]] = measured[own]
    return values


def opened(depth: NDArray[np.int32], half: float) -> NDArray[np.bool_]:
    """Tell which cells a disc within the plan covers: its radius in cells, squared depths given."""
    core = (depth >= half**2).astype(np.uint8)
    return np.asarray(square_distances(core, 1, math.ceil(half + 1.0)) <= (half + 1.0) ** 2)


@kernel
def closed(plan):  # type: ignore[no-untyped-def]
    """Return a plan with cells filled that are empty by chance: gaps of few cells."""
    n, m = plan.shape
    grown, found = np.zeros((n, m), dtype=np.uint8), plan.copy()
    for i in range(1, n - 1):
        for j in range(1, m - 1):
            middle = plan[i, j - 1] | plan[i, j] | plan[i, j + 1]
            north = plan[i + 1, j - 1] | plan[i + 1, j] | plan[i + 1, j + 1]
            grown[i, j] = middle | north | plan[i - 1, j - 1] | plan[i - 1, j] | plan[i - 1, j + 1]
    for i in range(1, n - 1):
        for j in range(1, m - 1):
            middle = grown[i, j - 1] & grown[i, j] & grown[i, j + 1]
            north = grown[i + 1, j - 1] & grown[i + 1, j] & grown[i + 1, j + 1]
            found[i, j] |= middle & north & grown[i - 1, j - 1] & grown[i - 1, j] & grown[i - 1, j + 1]
    return found
