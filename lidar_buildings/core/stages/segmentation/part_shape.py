"""How wide a part is, from sums over its points that add up when parts merge."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.point_array import extent_of


def plan_sums(points: NDArray[np.float64], part: NDArray[np.int64], n_parts: int) -> NDArray[np.float64]:
    """
    Return the number of points and the sums of x, y, x², y² and xy of every part, shape (n_parts, 6).

    Coordinates are taken from the middle of all points, in which squares keep their digits.
    """
    if not len(points):
        return np.zeros((n_parts, 6))
    x, y = (points[:, :2] - extent_of(points[:, :2]).sum(axis=0) / 2.0).T
    terms = (np.ones(len(x)), x, y, x * x, y * y, x * y)
    return np.column_stack([np.bincount(part, weights=term, minlength=n_parts) for term in terms])


def spread_width(sums: NDArray[np.float64]) -> float:
    """
    Return the width of the rectangle with the least scatter of a part's points [m].

    Points spread evenly over a width w scatter by w/√12. Bent parts, whose points scatter more, come out
    wider than they are.
    """
    n, x, y, xx, yy, xy = sums.tolist()
    if n < 1.0:
        return 0.0
    xx, yy, xy = xx / n - (x / n) ** 2, yy / n - (y / n) ** 2, xy / n - x * y / n**2
    least = (xx + yy) / 2.0 - math.hypot((xx - yy) / 2.0, xy)
    return math.sqrt(12.0 * max(least, 0.0))


def rectangle_width(area: float, perimeter: float) -> float:
    """
    Return the shorter side of the rectangle with this area and perimeter, of the square where there is none.
    """
    half = perimeter / 2.0
    root = half * half - 4.0 * area
    return (half - math.sqrt(root)) / 2.0 if root > 0.0 else math.sqrt(area)
