"""Walls that are as large as a building's: a scanner on the street sees them without their roofs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: How far a wall rises above `min_height`: fences, hedges, lorries and ground floors alone rise less [m].
MIN_RISE = 2.5


def wall_areas(
    points: NDArray[np.float64], label: NDArray[np.int64], min_width: float
) -> NDArray[np.float64]:
    """
    Return length times height of upright patches [m²], 0 for those that are too low or short for a building.
    """
    n = np.bincount(label)
    order = np.lexsort((points[:, 2], label))
    last = np.cumsum(n) - 1
    rise = points[order[last], 2] - points[order[last - n + 1], 2]
    x, y = (away - (np.bincount(label, away) / n)[label] for away in points[:, :2].T)
    xx, yy, xy = (np.bincount(label, one) / n for one in (x * x, y * y, x * y))
    # The variance of an even line is a twelfth of its length's square.
    length = np.sqrt(12.0 * (0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)))
    return np.where((rise >= MIN_RISE) & (length >= min_width), length * rise, 0.0)
