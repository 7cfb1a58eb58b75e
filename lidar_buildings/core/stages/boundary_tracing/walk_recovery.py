"""Recovery of walks: wider neighbourhoods where one got stuck or left points on the wrong side."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.stages.boundary_tracing.point_grid import PointGrid, cells_within, span_of
from lidar_buildings.core.stages.boundary_tracing.walk import GROWTH


@kernel
def widen_about(grid, reach, row, max_reach):  # type: ignore[no-untyped-def]
    """Widen the reach of the points about one from which there was no way on; False where it cannot grow."""
    x, y, n = grid.x, grid.y, grid.n_columns
    about = 2.0 * reach[row]
    is_wider = False
    low_row, high_row, low_column, high_column = cells_within(grid, x[row], y[row], about)
    for line in range(low_row, high_row + 1):
        for i in range(grid.first[line * n + low_column], grid.first[line * n + high_column + 1]):
            wider = min(reach[i] * GROWTH, max_reach)
            if wider > reach[i] and span_of(grid, x[i] - x[row], y[i] - y[row]) <= about:
                reach[i] = wider
                is_wider = True
    return is_wider


def bridge_gap(
    grid: PointGrid,
    reach: NDArray[np.float64],
    wrong: NDArray[np.int64],
    ring: NDArray[np.int64],
    max_reach: float,
) -> bool:
    """
    Widen the reach where points on a ring's wrong side are nearest to it; False where it cannot grow.

    The smallest reach is sought with which a point on the wrong side and one of the ring see each other and
    have not tried it. All pairs that it suffices for get it: a wing that no walk entered is joined at its
    nearest points, and keeps its shape elsewhere.
    """
    on_ring = np.zeros(len(reach), dtype=np.bool_)
    on_ring[ring] = True
    level = 1.0
    while level < max_reach:
        level = min(level * GROWTH, max_reach)
        if _widen_pairs(grid, reach, wrong, on_ring, level):
            return True
    return False


@kernel
def _widen_pairs(grid, reach, rows, on_ring, level):  # type: ignore[no-untyped-def]
    """
    Raise the reach of points and of the ring's points near them to a level; False if all have it already.
    """
    n, is_wider = grid.n_columns, False
    for row in rows:
        x, y = grid.x[row], grid.y[row]
        low_row, high_row, low_column, high_column = cells_within(grid, x, y, level)
        for line in range(low_row, high_row + 1):
            for i in range(grid.first[line * n + low_column], grid.first[line * n + high_column + 1]):
                is_new = on_ring[i] and (reach[i] < level or reach[row] < level)
                if is_new and span_of(grid, grid.x[i] - x, grid.y[i] - y) <= level:
                    reach[i], reach[row] = max(reach[i], level), max(reach[row], level)
                    is_wider = True
    return is_wider
