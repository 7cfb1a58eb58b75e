"""Which returns end their pulse, and which are all that came back of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.point_array import checked_column
from lidar_buildings.core.neighbours.neighbourhoods import build_grid, neighbours_of
from lidar_buildings.core.neighbours.parallel import for_row_blocks

#: Returns of a pulse this near one another came from one surface: scanners that record a first and a last
#: return of every pulse give the same echo twice, some centimetres apart [m].
SAME_ECHO = 0.3


def last_and_only_returns(
    points: NDArray[np.float64], return_number: ArrayLike | None, number_of_returns: ArrayLike | None
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """
    Tell which points are the last return of their pulse, and which are its only one.

    Where no pulse has a single return, the scanner recorded two of every pulse. A point then counts as the
    only return if another return number lies next to it. Every point does if either column is missing.
    """
    n = len(points)
    if return_number is None or number_of_returns is None:
        return np.ones(n, dtype=bool), np.ones(n, dtype=bool)
    number = checked_column("return_number", return_number, n, np.int64)
    of = checked_column("number_of_returns", number_of_returns, n, np.int64)
    is_only = of <= 1
    if n and not is_only.any():
        grid = build_grid(points, SAME_ECHO)
        for_row_blocks(lambda begin, end: _find_twins(grid, number, is_only, begin, end), n)
    return (number >= of) | is_only, is_only


@kernel
def _find_twins(grid, number, has_twin, begin, end):  # type: ignore[no-untyped-def]
    """Mark sorted points begin to end next to which a return of another number lies."""
    near = np.empty(len(grid.points), dtype=np.int64)
    for i in range(begin, end):
        x, y, z = grid.points[i]
        row = grid.rows[i]
        for k in range(neighbours_of(grid, grid.cell[i], x, y, z, SAME_ECHO, False, near)):
            if number[grid.rows[near[k]]] != number[row]:
                has_twin[row] = True
                break
