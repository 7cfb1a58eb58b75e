"""Walls moved from where they were found to where they are drawn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.stages.regularisation.assembly import Fit, WalledRing
from lidar_buildings.core.stages.regularisation.collinear_walls import on_common_lines
from lidar_buildings.core.stages.regularisation.joints import find_joint
from lidar_buildings.core.stages.regularisation.samples import RingSamples
from lidar_buildings.core.stages.regularisation.walls import move_out, offset_of


def through_all_points(samples: RingSamples, walled: WalledRing, fit: Fit) -> WalledRing:
    """
    Move walls from the bearing points to the middle of all points on them.

    Walls are found by the points that bear the ring, the outermost ones; the line of least squares through
    all points of a wall, as Sampath & Shan (2007) adjust it, lies inside.
    """
    offsets = _mean_offsets(
        samples.ring, samples.is_on_wall, samples.rows, len(samples.points), *walled[:2], walled.shape
    )
    return _drawn_anew(samples, walled, fit, offsets)


def offset_outwards(samples: RingSamples, walled: WalledRing, fit: Fit, distance: float) -> WalledRing:
    """Move all walls away from the building."""
    distances = np.full(len(walled.first), distance)
    return _drawn_anew(samples, walled, fit, distances)


def _drawn_anew(
    samples: RingSamples, walled: WalledRing, fit: Fit, distances: NDArray[np.float64]
) -> WalledRing:
    """Move each wall out by its distance [m], lay those in line on one line, and join them again."""
    moved = walled._replace(shape=_moved(samples.points, walled.first, walled.last, walled.shape, distances))
    shape = on_common_lines(samples, moved, fit)
    joints = _joints(samples.points, *walled[:2], shape, fit.min_step, fit.shortest)
    return walled._replace(shape=shape, joints=joints)


@kernel
def _mean_offsets(ring, is_on_wall, rows, n_samples, first, last, shape):  # type: ignore[no-untyped-def]
    """Return how far outside each wall its points lie in the mean, negative inside [m]."""
    n = len(ring)
    offsets = np.zeros(len(first))
    for i in range(len(first)):
        row, end = rows[first[i]], rows[(last[i] - 1) % n_samples]
        before, behind = ring[(row - 1) % n], ring[(end + 1) % n]
        dx, dy = behind[0] - before[0], behind[1] - before[1]
        n_rows = (end - row) % n + 1
        if n_rows == 1 and 2 * (last[i] - first[i]) > n_samples:  # all round, and begun within an edge
            n_rows = n
        total, count = 0.0, 0
        for k in range(row, row + n_rows):
            if is_on_wall[k % n]:
                total += offset_of(shape[i], dx, dy, ring[k % n, 0], ring[k % n, 1])
                count += 1
        if count:
            offsets[i] = total / count
    return offsets


@kernel
def _moved(points, first, last, shape, distances):  # type: ignore[no-untyped-def]
    """Return the shapes of walls that were moved out, each by its distance."""
    n, shape = len(points), shape.copy()
    for i in range(len(first)):
        a, b = (first[i] - 1) % n, last[i] % n
        move_out(shape[i], points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], distances[i])
    return shape


@kernel
def _joints(points, first, last, shape, min_step, shortest):  # type: ignore[no-untyped-def]
    """Return the joints of walls that have moved."""
    m = len(first)
    joints = np.zeros((m, 2, 2))
    for i in range(m if m > 1 else 0):
        find_joint(points, first, last, shape, i, (i + 1) % m, min_step, shortest, joints[i])
    return joints
