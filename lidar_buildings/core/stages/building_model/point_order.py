"""The order in which a building's points are looked at, whatever order they come in."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.few_rows import rows_by_number


def rows_in_order(points: FloatArray, plane_id: NDArray[np.uint16]) -> IntArray:
    """Return the rows by y, x, z and plane; all but y are looked at only where it is equal."""
    x, y, z = points.T
    order = np.argsort(y)
    tied = _tied(y[order])
    rows = order[tied]
    tied_y = y[rows]
    number = np.zeros(len(rows), dtype=np.int64)
    np.cumsum(tied_y[1:] > tied_y[:-1], out=number[1:])
    by_x = np.argsort(x[rows])
    rows = rows[by_x[rows_by_number(number[by_x], len(rows))]]
    over = _tied(x[rows] + 1j * y[rows])
    own = rows[over]
    rows[over] = own[np.lexsort((plane_id[own], z[own], x[own], y[own]))]
    order[tied] = rows
    return order


def _tied(values: NDArray[Any]) -> IntArray:
    """Return the places of values that equal the one before or after them."""
    equal = values[1:] == values[:-1]
    tied = np.zeros(len(values), dtype=np.bool_)
    tied[1:] = equal
    tied[:-1] |= equal
    return tied.nonzero()[0]
