"""How densely objects stand on the terrain around."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.cell_grid import sort_by_cell

#: Side of the cells that are counted [m], and the number of them around: `bench.ground.isprs` and `.scenes`.
CELL, RADIUS = 10.0, 6


def object_density(candidates: NDArray[np.float64], is_object: NDArray[np.bool_]) -> NDArray[np.float64]:
    """
    Return the share of objects among the candidates around each, 0 to 1.

    Cells up to 60 m away along x and y count with Gaussian weights (σ = 30 m).

    Parameters
    ----------
    candidates : ndarray of shape (n_candidates, 3)
        At least one [m].
    is_object : ndarray of shape (n_candidates,), bool
        Which of them are objects beyond doubt.
    """
    cells = sort_by_cell(candidates, CELL)
    n_objects = np.add.reduceat(is_object[cells.rows].astype(np.float64), cells.first[:-1])
    n_all = np.diff(cells.first).astype(np.float64)
    share = np.divide(*_smoothed(cells.numbers, cells.n_columns, np.stack((n_objects, n_all))))
    density = np.empty(len(candidates))
    density[cells.rows] = np.repeat(share, np.diff(cells.first))
    return density


@njit(cache=True, nogil=True)
def _smoothed(numbers, n_columns, values):  # type: ignore[no-untyped-def]
    """
    Return the weighted sums of values (k, n_cells) over the cells around; only occupied cells take part.
    """
    total = np.zeros_like(values)
    for north in range(-RADIUS, RADIUS + 1):
        # Cells are numbered row by row: as k goes on, so does the first cell in reach.
        begin = 0
        for k in range(len(numbers)):
            column, middle = numbers[k] % n_columns, numbers[k] + north * n_columns
            west, east = min(column, RADIUS), min(n_columns - 1 - column, RADIUS)
            while begin < len(numbers) and numbers[begin] < middle - west:
                begin += 1
            j = begin
            while j < len(numbers) and numbers[j] <= middle + east:
                away = numbers[j] - middle
                weight = math.exp(-2.0 * (north * north + away * away) / RADIUS**2)
                for value in range(len(values)):
                    total[value, k] += weight * values[value, j]
                j += 1
    return total
