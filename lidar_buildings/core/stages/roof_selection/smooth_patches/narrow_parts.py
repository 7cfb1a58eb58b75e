"""What is too narrow to be a roof, in the plan of the columns that hold points: hedges, walls."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.columns import Columns
from lidar_buildings.core.surfaces.morphology import square_distances

#: Cells across the narrowest part: a disc of fewer is too coarse to tell what is as wide.
MIN_CELLS = 5.0
#: Cells along the side of the blocks in which the plan is handled, so that far points cost no memory.
BLOCK = 512


def wide_enough(columns: Columns, min_width: float) -> NDArray[np.bool_]:
    """
    Tell which columns lie within a disc, of this diameter, that lies within the plan of the points.

    An opening: the plan is cut back by half the width and grown again by as much, and by half a column, which
    is no narrower than a spacing, else a roof is full of gaps. What lies farther away than the width and some
    columns does not matter. All pass a width below `MIN_CELLS` columns, which says nothing.
    """
    half = 0.5 * min_width / columns.size
    if half < 0.5 * MIN_CELLS:
        return np.ones(len(columns.numbers), dtype=bool)
    is_wide, holds = np.zeros(len(columns.numbers), dtype=bool), np.flatnonzero(np.diff(columns.first))
    line, place = np.ascontiguousarray(columns.places[holds].T)
    margin = 2 * math.ceil(half) + 4
    band = line // BLOCK
    for north in band[np.flatnonzero(np.diff(band, prepend=-1))] * BLOCK:
        begin, end = np.searchsorted(line, (north - margin, north + BLOCK + margin))
        for east in np.unique(place[begin:end] // BLOCK) * BLOCK:
            near = (place[begin:end] >= east - margin) & (place[begin:end] < east + BLOCK + margin)
            y, x = line[begin:end][near], place[begin:end][near]
            south, west = y.min() - 2, x.min() - 2
            plan = np.zeros((y.max() + 3 - south, x.max() + 3 - west), dtype=np.uint8)
            plan[y - south, x - west] = 1
            found = opened(square_distances(closed(plan), 0, math.ceil(half)), half)[y - south, x - west]
            own = (y >= north) & (y < north + BLOCK) & (x >= east) & (x < east + BLOCK)
            is_wide[holds[begin:end][near][own]] = found[own]
    return is_wide


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
