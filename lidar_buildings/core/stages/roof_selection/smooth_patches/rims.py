"""Where roofs end: beside a building the air is free, beside a smooth spot in foliage more foliage stands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.columns import Columns

#: How far what goes on may lie above or below the rim: less than a storey, more than a crown is rough [m].
MAX_STEP = 2.0
#: Largest share of the rim beyond which something goes on: houses under trees have 0.4, spots in forests 0.9.
MAX_SHARE = 0.5
#: What stands in one direction of a cell: the same roof, or what is none at its level, anything behind that.
OWN, LEVEL, BEHIND = 1, 2, 4


def stands_out(
    cells: Columns, elevation: NDArray[np.float64], building: NDArray[np.int64], n_buildings: int
) -> NDArray[np.bool_]:
    """
    Tell which buildings, or parts of them, end: along most of their rims nothing goes on at their level.

    What is one cell wide, a parapet or a façade, is an end, and so are the end of the data and another roof:
    a tower stands out of the roofs around it, a crown that hangs over a roof does not. Cells are such
    that a surface leaves few empty; elevations [m] and buildings, −1 being none, come cell by cell.
    """
    rim, met = np.zeros((2, n_buildings), dtype=np.int64)
    runs = cells.around(2.0 * cells.size)
    _count_rims(elevation, cells.first, cells.places, runs, building, rim, met)
    return np.asarray(met <= MAX_SHARE * rim)


@kernel
def _count_rims(elevation, first, places, runs, building, rim, met):  # type: ignore[no-untyped-def]
    """Count, by building, the directions of its cells that lead out of roofs, and those where it goes on."""
    top = np.full(len(places), -1, dtype=np.int64)
    for k in range(len(places)):
        for i in range(first[k], first[k + 1]):
            if building[i] >= 0 and (top[k] < 0 or elevation[i] >= elevation[top[k]]):
                top[k] = i
    seen = np.empty((3, 3), dtype=np.int64)
    for k in range(len(places)):
        if top[k] < 0:
            continue
        seen[:] = 0
        seen[1, 1] = OWN
        for row in range(runs.shape[1]):
            for c in range(runs[k, row, 0], runs[k, row, 1]):
                dy, dx = places[c, 0] - places[k, 0], places[c, 1] - places[k, 1]
                if max(abs(dy), abs(dx)) == 1:
                    if top[c] >= 0 and building[top[c]] == building[top[k]]:
                        seen[1 + dy, 1 + dx] |= OWN
                    elif _has_level(elevation, building, first[c], first[c + 1], elevation[top[k]]):
                        seen[1 + dy, 1 + dx] |= LEVEL
                elif abs(dy) % 2 == 0 and abs(dx) % 2 == 0:
                    seen[1 + dy // 2, 1 + dx // 2] |= BEHIND
        for one in seen.ravel():
            rim[building[top[k]]] += one & OWN == 0
            met[building[top[k]]] += one == LEVEL | BEHIND


@kernel
def _has_level(elevation, building, begin, end, level):  # type: ignore[no-untyped-def]
    """Tell whether points of no roof lie at a level."""
    n = 0
    for i in range(begin, end):
        n += building[i] < 0 and abs(elevation[i] - level) <= MAX_STEP
    return n > 0
