"""Sums over the neighbours of a point within each of several radii, in one pass over the neighbours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.windows import z_range
from lidar_buildings.core.surfaces.point_moments import add_point

#: Points looked at around one cell; where there are more, every second, third… by elevation of each cell is
#: taken. The window of three by three cells holds three times as many points as the disc of that radius.
MAX_CANDIDATES = 4608
#: Bins of the squared distance by which shells are looked up.
LOOKUP_BINS = 256


@kernel
def gather_window(cloud, windows, low, high, near):  # type: ignore[no-untyped-def]
    """
    Write the points of a window of cells, from elevation `low` to `high`, to the rows of `near`.

    Return how many there are; what is beyond is rubbish. More than `MAX_CANDIDATES` are thinned evenly.
    """
    candidates = 0
    for begin, end in windows:
        candidates += cloud.first[end] - cloud.first[begin]
    if candidates > MAX_CANDIDATES:
        return _gather_thinned(cloud, windows, low, high, near)
    found = 0
    for begin, end in windows:
        for j in range(cloud.first[begin], cloud.first[end]):
            # Written always, kept if at the right elevation: quicker than a branch.
            x, y, z = cloud.points[j]
            near[0, found], near[1, found], near[2, found] = x, y, z
            found += (z >= low) & (z <= high)
    return found


@kernel
def _gather_thinned(cloud, windows, low, high, near):  # type: ignore[no-untyped-def]
    """Do the same where the points of all elevations may be too many."""
    z = cloud.points[:, 2]
    candidates = 0
    for begin, end in windows:
        for c in range(begin, end):
            start, stop = z_range(z, cloud.first[c], cloud.first[c + 1], low, high)
            candidates += stop - start
    stride = 1 + (candidates - 1) // MAX_CANDIDATES
    found = 0
    for begin, end in windows:
        for c in range(begin, end):
            start, stop = z_range(z, cloud.first[c], cloud.first[c + 1], low, high)
            for j in range(start, stop, stride):
                near[0, found], near[1, found], near[2, found] = cloud.points[j]
                found += 1
    return found


@kernel
def rows_within(near, n_near, position, square_reach, square, rows):  # type: ignore[no-untyped-def]
    """
    Write the squared distances from a position, and which of the points are within reach; return how many.
    """
    x, y, z = near[0], near[1], near[2]
    for j in range(n_near):
        dx, dy, dz = x[j] - position[0], y[j] - position[1], z[j] - position[2]
        square[j] = dx * dx + dy * dy + dz * dz
    found = 0
    for j in range(n_near):
        # Written always, kept if near: a branch here would be mispredicted half of the time.
        rows[found] = j
        found += square[j] <= square_reach
    return found


@kernel
def sum_shells(near, rows, position, square, squares, lookup, shells):  # type: ignore[no-untyped-def]
    """Sum 1, d and d dᵀ over the neighbours between one radius and the next."""
    shells[:] = 0.0
    scale = LOOKUP_BINS / squares[-1]
    x, y, z = near[0], near[1], near[2]
    for j in rows:
        k = lookup[np.uint64(square[j] * scale)]
        while square[j] > squares[k]:
            k += np.uint64(1)
        dx, dy, dz = x[j] - position[0], y[j] - position[1], z[j] - position[2]
        add_point(shells[k], dx, dy, dz)


def shell_lookup(squares: NDArray[np.float64]) -> NDArray[np.uint64]:
    """
    Return, by the bins of the squared distance, a shell that is not too far out.

    Few bins hold a limit between two shells. The last one is for the largest radius itself.
    """
    lowest = np.arange(LOOKUP_BINS + 1) * (squares[-1] / LOOKUP_BINS) * (1 - 1e-9)
    return np.searchsorted(squares, lowest).astype(np.uint64)
