"""The plane through a point that most of its neighbours lie on: roofs where points are few."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.stages.roof_selection.candidates import MAX_SLOPE_DEG

#: Neighbours that vote: two rings around a point on an even surface.
N_VOTERS = 12
#: Least sine of the angle between the two neighbours that span a plane with the point.
MIN_SINE = 0.4


def plane_votes(
    points: NDArray[np.float64], max_distance: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """
    Return how many of each point's nearest neighbours lie on one plane through it, and its normal.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        [m].
    max_distance : float
        Largest distance from the plane [m].

    Returns
    -------
    votes : ndarray of int64, shape (n_points,)
        0 to `N_VOTERS`.
    normals : ndarray of shape (n_points, 3)
        Unit, z > 0; straight up where no plane is found. Of planes with as many votes the first.
    """
    n = len(points)
    votes, normals = np.zeros(n, dtype=np.int64), np.zeros((n, 3))
    normals[:, 2] = 1.0
    if n <= N_VOTERS:
        return votes, normals
    near = cKDTree(points).query(points, N_VOTERS + 1)[1]
    least = math.cos(math.radians(MAX_SLOPE_DEG))
    for_row_blocks(lambda a, b: _vote(points, near, max_distance, least, votes, normals, a, b), n)
    return votes, normals


def mean_votes(points: NDArray[np.float64], votes: NDArray[np.integer]) -> NDArray[np.float64]:
    """
    Return the mean votes of each point and its nearest neighbours in plan.

    One point's votes say little where faces hold few points; a crown has few votes as a whole.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        Everything that is high enough to be roof, whichever the return [m].
    votes : ndarray of int, shape (n_points,)
        0 for returns that others of their pulse came after: foliage has many.
    """
    if len(points) <= N_VOTERS:
        return votes.astype(np.float64)
    plan = points[:, :2]
    return np.asarray(votes[cKDTree(plan).query(plan, N_VOTERS + 1)[1]].mean(axis=1))


@kernel
def _vote(points, near, max_distance, min_upward, votes, normals, begin, end):  # type: ignore[no-untyped-def]
    away = np.empty((near.shape[1], 3))
    for i in range(begin, end):
        for k in range(near.shape[1]):
            for axis in range(3):
                away[k, axis] = points[near[i, k], axis] - points[i, axis]
        for a in range(1, len(away)):
            for b in range(a + 1, len(away)):
                (ax, ay, az), (bx, by, bz) = away[a], away[b]
                x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
                length = math.sqrt(x * x + y * y + z * z)
                spans = (ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz)
                if length <= MIN_SINE * math.sqrt(spans) or abs(z) < min_upward * length:
                    continue
                scale = (1.0 if z > 0.0 else -1.0) / length
                x, y, z = scale * x, scale * y, scale * z
                found = -1
                for k in range(len(away)):
                    off = x * away[k, 0] + y * away[k, 1] + z * away[k, 2]
                    found += abs(off) <= max_distance
                if found > votes[i]:
                    votes[i] = found
                    normals[i, 0], normals[i, 1], normals[i, 2] = x, y, z
