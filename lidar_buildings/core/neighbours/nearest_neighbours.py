"""How far the n-th nearest neighbour in plan is, from a grid: quicker than a tree for few of many points."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.neighbours.parallel import for_row_blocks

#: A cell's side in units of 1/√density for each √n: neighbours mostly lie in the cells round a point's own.
CELL = 0.62
#: Cells on each side that are looked at, one attempt after the other.
REACHES = (1, 2, 4)
#: A neighbour this little inside what has been looked at may be beyond it by rounding.
SLACK = 1.0 - 1e-9
#: Points that the density is guessed from, and the neighbours of each.
N_GUESS, NEIGHBOURS_TO_GUESS = 800, 4
#: Positions a block of work.
BLOCK = 1024


def nth_distances(
    plan: NDArray[np.float64], probes: NDArray[np.float64], n: int
) -> tuple[NDArray[np.float64], float]:
    """
    Return the distances from some points to their n-th nearest ones, where these are near.

    Parameters
    ----------
    plan : ndarray of shape (n_points, 2)
        Distinct positions, at least n [m].
    probes : ndarray of shape (n_probes, 2)
        Some of them.
    n : int
        The first is the probe itself.

    Returns
    -------
    distances : ndarray of shape (n_probes,)
        The same numbers that a search by tree finds; infinite where they are more than `reach` [m].
    reach : float
        A few times what is usual [m].
    """
    flat = np.zeros((len(plan), 3))
    flat[:, :2] = plan
    # Positions may be so near that the square of their distance is 0.
    side = max(CELL * math.sqrt(n) * _guessed_spacing(plan), float(np.finfo(np.float64).tiny))
    cloud = sort_by_cell(flat, side)
    origin = np.floor(plan.min(axis=0) / cloud.size)
    distances = np.empty(len(probes))
    for_row_blocks(lambda a, b: _search(cloud, origin, probes, n, distances, a, b), len(probes), BLOCK)
    return distances, SLACK * REACHES[-1] * cloud.size


def _guessed_spacing(plan: NDArray[np.float64]) -> float:
    """Guess 1/√density from a part of the points; only the time depends on it."""
    step = max(1, len(plan) // N_GUESS)
    some = plan[::step]
    k = min(NEIGHBOURS_TO_GUESS, len(some) - 1)
    far = float(np.median(cKDTree(some).query(some, [k + 1])[0]))
    return far * math.sqrt(math.pi / (k * step))


@njit(cache=True, nogil=True)
def _search(cloud, origin, probes, n, distances, begin, end):  # type: ignore[no-untyped-def]
    """Fill the distances of probes begin to end."""
    nearest = np.empty(n)
    for i in range(begin, end):
        distances[i] = np.inf
        for reach in REACHES:
            _find_nearest(cloud, origin, probes[i], reach, nearest)
            distance = math.sqrt(nearest[-1])
            if distance <= SLACK * reach * cloud.size:
                distances[i] = distance
                break


@njit(cache=True, nogil=True)
def _find_nearest(cloud, origin, probe, reach, nearest):  # type: ignore[no-untyped-def]
    """
    Write the least squared distances, rising, to the points of a window of cells; infinite beyond the last.
    """
    nearest[:] = np.inf
    column = np.int64(math.floor(probe[0] / cloud.size) - origin[0])
    row = np.int64(math.floor(probe[1] / cloud.size) - origin[1])
    west, east = max(column - reach, 0), min(column + reach, cloud.n_columns - 1)
    for beside in range(row - reach, row + reach + 1):
        first = np.searchsorted(cloud.numbers, beside * cloud.n_columns + west)
        last = np.searchsorted(cloud.numbers, beside * cloud.n_columns + east, side="right")
        for j in range(cloud.first[first], cloud.first[last]):
            dx, dy = cloud.points[j, 0] - probe[0], cloud.points[j, 1] - probe[1]
            square = dx * dx + dy * dy
            if square < nearest[-1]:
                _insert(nearest, square)


@njit(cache=True, nogil=True)
def _insert(nearest, square):  # type: ignore[no-untyped-def]
    """Put a number in its place among rising ones, of which the last is lost."""
    k = len(nearest) - 1
    while k > 0 and nearest[k - 1] > square:
        nearest[k] = nearest[k - 1]
        k -= 1
    nearest[k] = square
