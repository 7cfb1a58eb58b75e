"""How densely objects stand on the terrain around."""

from __future__ import annotations

import math

import numpy as np
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


def _smoothed(numbers: NDArray[np.int64], n_columns: int, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return the weighted sums of values (k, n_cells) over the cells around; only occupied cells take part.
    """
    total, column = np.zeros_like(values), numbers % n_columns
    for north in range(-RADIUS, RADIUS + 1):
        for east in range(-RADIUS, RADIUS + 1):
            wanted = numbers + (north * n_columns + east)
            place = np.minimum(np.searchsorted(numbers, wanted), len(numbers) - 1)
            is_there = (numbers[place] == wanted) & (column + east >= 0) & (column + east < n_columns)
            weight = math.exp(-2.0 * (north * north + east * east) / RADIUS**2)
            total[:, is_there] += weight * values[:, place[is_there]]
    return total
