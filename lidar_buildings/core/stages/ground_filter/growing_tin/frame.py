"""Terrain beyond the outermost vertices: the virtual points of the frame carry it on as it slopes there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import kernel

# Chosen with `bench.ground.isprs` and `bench.ground.scenes`.
#: Seeds that the slope at a virtual point is taken from.
NEIGHBOURS = 6
#: Added to the seeds' variance in plan as if it were level: slopes hold only where they reach [m²].
LEVEL_VARIANCE = 100.0


def edge_gradients(seeds: NDArray[np.float64], frame: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return the terrain's rise over run along x and y at each virtual point, from the seeds nearest to it.

    Least squares, damped so that seeds close together or on a line say nothing about where they do not reach.
    """
    k = min(NEIGHBOURS, len(seeds))
    _, nearest = cKDTree(seeds[:, :2]).query(frame[:, :2], [*range(1, k + 1)])
    around = seeds[nearest]
    around = around - around.mean(axis=1, keepdims=True)
    plan, rise = around[..., :2], around[..., 2:]
    normal = np.swapaxes(plan, 1, 2) @ plan + k * LEVEL_VARIANCE * np.eye(2)
    return np.linalg.solve(normal, np.swapaxes(plan, 1, 2) @ rise)[..., 0]


@kernel
def at_frame(triangle, triangles, n_real, n_start):  # type: ignore[no-untyped-def]
    """Whether a triangle has a virtual corner: rows `n_real` to `n_start` are the virtual vertices."""
    a, b, c = triangles[triangle, 0], triangles[triangle, 1], triangles[triangle, 2]
    return n_real <= a < n_start or n_real <= b < n_start or n_real <= c < n_start


@kernel
def extend_terrain(vertices, n_real, n_start, triangles, border, gradient):  # type: ignore[no-untyped-def]
    """
    Raise each virtual vertex to the slope beyond the nearest real one that it shares a triangle with.

    Parameters
    ----------
    vertices : ndarray of shape (n, 3)
        Rows `n_real` to `n_start` are the virtual ones; changed in place [m].
    n_real, n_start : int
        See `vertices`.
    triangles : ndarray of shape (m, 3), int32
        The mesh so far.
    border : ndarray of int32
        The triangles with a virtual corner, rising: of several real vertices as near, the first counts.
    gradient : ndarray of shape (n_start - n_real, 2)
        As `edge_gradients` gives it.

    Returns
    -------
    ndarray of shape (n_start - n_real,), bool
        Which virtual vertices moved.
    """
    least = np.full(n_start - n_real, np.inf)
    elevation = np.empty(n_start - n_real)
    for f in range(n_start - n_real):
        elevation[f] = vertices[n_real + f, 2]
    for t in border:
        for v in triangles[t]:
            if not n_real <= v < n_start:
                continue
            for w in triangles[t]:
                dx, dy = vertices[v, 0] - vertices[w, 0], vertices[v, 1] - vertices[w, 1]
                away = dx * dx + dy * dy
                f = v - n_real
                if not n_real <= w < n_start and away < least[f]:
                    least[f] = away
                    elevation[f] = vertices[w, 2] + gradient[f, 0] * dx + gradient[f, 1] * dy
    moved = np.empty(n_start - n_real, dtype=np.bool_)
    for f in range(n_start - n_real):
        moved[f] = elevation[f] != vertices[n_real + f, 2]
        vertices[n_real + f, 2] = elevation[f]
    return moved
