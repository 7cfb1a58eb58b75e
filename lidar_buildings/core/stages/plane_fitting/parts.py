"""Connected parts of planes: a plane whose parts lie apart is as many planes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import IntArray
from lidar_buildings.core.neighbours.union_find import flatten, link


@kernel
def split_planes(
    neighbours: NDArray[np.int32], labels: NDArray[np.int32], min_points: int
) -> NDArray[np.int32]:
    """
    Make every connected part of a plane a plane of its own; parts with too few points are dissolved.

    Parameters
    ----------
    neighbours : ndarray of shape (n_points, n_neighbours), int32
        Rows of near points, first those that there are, then −1.
    labels : ndarray of shape (n_points,), int32
        Plane numbers, 0 = none.
    min_points : int
        Fewest points of a part.
    """
    part = connected_parts(neighbours, labels)
    size = np.zeros(len(part), np.int64)
    for i in range(len(part)):
        size[part[i]] += labels[i] > 0
    number = np.zeros(len(part), np.int32)
    n = 0
    for i in range(len(part)):
        if size[part[i]] < min_points:
            continue
        # A part is named after its lowest row, which therefore comes first.
        if part[i] == i:
            n += 1
            number[i] = n
        number[i] = number[part[i]]
    return number


@inner_kernel
def connected_parts(neighbours: NDArray[np.int32], labels: NDArray[np.int32]) -> IntArray:
    """Return the lowest row of the connected part of one plane that each point is of."""
    part = np.arange(len(labels))
    for i in range(len(labels)):
        for j in neighbours[i]:
            if j < 0 or labels[i] == 0:
                break
            if labels[j] == labels[i] and part[j] != part[i]:
                link(part, i, j)
    flatten(part)
    return part
