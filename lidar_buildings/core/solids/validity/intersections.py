"""Shells that cross or touch themselves: triangles that meet where they must not."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.solids.validity.exact import whole_numbers
from lidar_buildings.core.solids.validity.triangle_pairs import triangles_meet


def self_intersects(vertices: FloatArray, triangles: IntArray, face_of: IntArray) -> bool:
    """
    Whether triangles of different faces meet elsewhere than in common vertices and edges: code 306.

    Boxes around the triangles are swept along the longest axis (Cohen et al. 1995); where two overlap, the
    triangles are tested exactly.

    Parameters
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        Map frame [m].
    triangles : ndarray of shape (n_triangles, 3)
        Rows of the vertices.
    face_of : ndarray of shape (n_triangles,)
        The face of each triangle: triangles of one face are not compared.
    """
    points = whole_numbers(vertices)
    sweep = int(np.argmax(np.ptp(points, axis=0)))
    points = np.ascontiguousarray(np.roll(points, -sweep, axis=1))
    corners = points[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    order = np.argsort(low[:, 0], kind="stable")
    return bool(_any_meet(points, triangles[order], face_of[order], low[order], high[order]))


@kernel
def _any_meet(
    points: IntArray, triangles: IntArray, face_of: IntArray, low: IntArray, high: IntArray
) -> bool:
    """Sweep the boxes in the order of their lower ends and test those that overlap."""
    for i in range(len(triangles)):
        for j in range(i + 1, len(triangles)):
            if low[j, 0] > high[i, 0]:
                break
            if low[j, 1] > high[i, 1] or low[i, 1] > high[j, 1]:
                continue
            if low[j, 2] > high[i, 2] or low[i, 2] > high[j, 2] or face_of[i] == face_of[j]:
                continue
            if triangles_meet(points, triangles[i], triangles[j]):
                return True
    return False
