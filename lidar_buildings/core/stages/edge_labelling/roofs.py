"""How roofs are numbered, found in plan, and kept from seeing one another."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours import union_find
from lidar_buildings.core.neighbours.cell_grid import CellGrid


def set_apart(
    points: NDArray[np.float64], roof_id: NDArray[np.int64] | None, reach: float
) -> NDArray[np.float64]:
    """
    Return the points with roofs lifted so far above one another that none is within reach of another [m].

    The lift is a multiple of a power of two: coordinates that fit a float32 keep their differences exactly.
    """
    if roof_id is None or len(points) == 0:
        return points
    number = numbered(roof_id)[1]
    lift = 2.0 ** math.ceil(math.log2(np.ptp(points[:, 2]) + 2.0 * reach))
    return points + np.outer(number * lift, [0.0, 0.0, 1.0])


def numbered(roof_id: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the roofs' numbers, rising, and each point's place among them."""
    low, high = (int(roof_id.min()), int(roof_id.max())) if len(roof_id) else (0, 0)
    if high - low >= len(roof_id):
        numbers, dense = np.unique(roof_id, return_inverse=True)
        return numbers, dense.reshape(-1)
    numbers = np.flatnonzero(np.bincount(roof_id - low)) + low
    if len(numbers) == high - low + 1:
        return numbers, roof_id if low == 0 else roof_id - low
    place = np.zeros(high - low + 1, dtype=np.int64)
    place[numbers - low] = np.arange(len(numbers))
    return numbers, place[roof_id - low]


def roofs_in_plan(cells: CellGrid) -> NDArray[np.int64]:
    """
    Number roofs from 0, per input row: points in cells that touch, be it at a corner, are of one.

    Cells are those of `build_grid`.
    """
    one, beside = np.nonzero(cells.adjacent >= 0)
    number = union_find.numbered(
        union_find.sets_of_pairs(len(cells.numbers), one, cells.adjacent[one, beside])
    )
    roof = np.empty(len(cells.points), dtype=np.int64)
    roof[cells.rows] = np.repeat(number, np.diff(cells.first))
    return roof
