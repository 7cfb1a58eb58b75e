"""Walls moved from where they were found to where they are drawn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.stages.regularisation.assembly import Fit, WalledRing, close_rows
from lidar_buildings.core.stages.regularisation.collinear_walls import on_common_lines
from lidar_buildings.core.stages.regularisation.joints import extent_of, find_joint, length_of
from lidar_buildings.core.stages.regularisation.samples import RingSamples
from lidar_buildings.core.stages.regularisation.walls import move_out, offset_of

#: Corners of walls that were moved lie so many times farther from the samples.
_MOVED = 1.5
#: Walls and steps that are left of this length, when walls were moved, are kept [smallest steps].
_LEAST_LEFT = 0.7


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
    return WalledRing(*_joined(samples.points, *walled[:3], shape, fit.min_step))


@kernel
def _mean_offsets(ring, is_on_wall, rows, n_samples, first, last, shape):  # type: ignore[no-untyped-def]
    """Return how far outside each wall its points lie in the mean, negative inside [m]."""
    n = len(ring)
    offsets = np.zeros(len(first))
    for i in range(len(first)):
        row, end = rows[first[i]], rows[(last[i] - 1) % n_samples]
        before, behind = ring[(row - 1) % n], ring[(end + 1) % n]
        total, count = 0.0, 0
        while True:
            if is_on_wall[row]:
                dx, dy = behind[0] - before[0], behind[1] - before[1]
                total += offset_of(shape[i], dx, dy, ring[row, 0], ring[row, 1])
                count += 1
            if row == end:
                break
            row = row + 1 if row + 1 < n else 0
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
def _joined(points, first, last, kind, shape, min_step):  # type: ignore[no-untyped-def]
    """Join walls that have moved; steps and walls that shrank by it too much are dropped."""
    m = len(first)
    first, last, kind = first.copy(), last.copy(), kind.copy()
    joints = np.zeros((m, 2, 2))
    while m > 1:
        for i in range(m):
            find_joint(points, first, last, shape, i, (i + 1) % m, _MOVED * min_step, joints[i])
        spoilt = _spoilt(points, first, last, shape, joints, m, _LEAST_LEFT * min_step)
        if spoilt < 0 or m <= 3:
            break
        m = close_rows(first, last, kind, shape, m, spoilt)
    return first[:m], last[:m], kind[:m], shape[:m], joints[:m]


@inner_kernel
def _spoilt(points, first, last, shape, joints, m, least):  # type: ignore[no-untyped-def]
    """
    Return a wall that is too short, or the shorter one beside a step that is too small, −1 if there is none.
    """
    for i in range(m):
        k, before = (i + 1) % m, i - 1 if i else m - 1
        if length_of(points, first, last, shape, i, joints[before, 1], joints[i, 0]) < least:
            return i
        step = np.hypot(joints[i, 0, 0] - joints[i, 1, 0], joints[i, 0, 1] - joints[i, 1, 1])
        if 0.0 < step < least:
            shorter = extent_of(points, first[i], last[i]) < extent_of(points, first[k], last[k])
            return i if shorter else k
    return -1
