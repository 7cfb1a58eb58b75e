"""
Vertices that count as one because they lie within a tolerance of each other.

"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


def weld(vertices: NDArray[np.float64], tolerance: float) -> NDArray[np.int64]:
    """
    Return for each vertex the row of the first one that it counts as.

    A vertex joins the earliest kept one that is nearer than the tolerance, as val3dity does it.

    Parameters
    ----------
    vertices : ndarray of shape (n, 3)
        Map frame [m].
    tolerance : float
        Distance [m].

    """
    if len(vertices) == 0:
        return np.empty(0, dtype=np.int64)
    axis = int(np.argmax(np.ptp(vertices, axis=0)))
    along = vertices[:, axis]
    order = np.argsort(along, kind="stable")
    return _leaders(vertices, order, along[order], tolerance)


@njit(cache=True, nogil=True)
def _leaders(
    vertices: NDArray[np.float64],
    order: NDArray[np.int64],
    along: NDArray[np.float64],
    tolerance: float,
) -> NDArray[np.int64]:
    """
    Go through the vertices in their order and look for kept ones near each along one axis.

    """
    n = len(order)
    place = np.empty(n, dtype=np.int64)
    for k in range(n):
        place[order[k]] = k
    leader = np.arange(n)
    for row in range(n):
        best = row
        for step in (-1, 1):
            k = place[row] + step
            while 0 <= k < n and abs(along[k] - along[place[row]]) < tolerance:
                other = order[k]
                if other < best and leader[other] == other and _near(vertices, row, other, tolerance):
                    best = other
                k += step
        leader[row] = best
    return leader


@njit(cache=True, nogil=True)
def _near(vertices: NDArray[np.float64], first: int, second: int, tolerance: float) -> bool:
    """
    Whether two vertices are nearer to each other than the tolerance.

    """
    squared = 0.0
    for axis in range(3):
        squared += (vertices[first, axis] - vertices[second, axis]) ** 2
    return squared < tolerance**2
