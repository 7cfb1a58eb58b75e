"""
How roofs are kept from seeing one another.

"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def set_apart(
    points: NDArray[np.float64], roof_id: NDArray[np.int64] | None, reach: float
) -> NDArray[np.float64]:
    """
    Return the points with roofs lifted so far above one another that none is within reach of another [m].

    The lift is a multiple of a power of two: coordinates that fit a float32 keep their differences exactly.

    """
    if roof_id is None or len(points) == 0:
        return points
    number = np.unique(roof_id, return_inverse=True)[1].reshape(-1)
    lift = 2.0 ** math.ceil(math.log2(np.ptp(points[:, 2]) + 2.0 * reach))
    return points + np.outer(number * lift, [0.0, 0.0, 1.0])
