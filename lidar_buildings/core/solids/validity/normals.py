"""Folds in faces: triangles of one face whose normals differ."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.solids.shell import cross
from lidar_buildings.core.solids.validity.codes import MARGIN, MAX_NORMAL_DEVIATION_DEG

#: Largest angle allowed between two triangles of a face [rad].
_MAX_ANGLE = math.radians(MAX_NORMAL_DEVIATION_DEG * (1.0 - MARGIN))
_LEAST_COSINE = math.cos(_MAX_ANGLE)
_COSINE_OF_HALF = math.cos(0.5 * _MAX_ANGLE)


def folds(vertices: FloatArray, triangles: IntArray, face_of: IntArray) -> BoolArray:
    """
    Return for each face whether it is folded: code 204.

    Parameters
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        Map frame [m].
    triangles : ndarray of shape (n_triangles, 3)
        Rows of the vertices.
    face_of : ndarray of shape (n_triangles,)
        The face of each triangle, rising.
    """
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    normals = cross(b - a, c - a)
    sizes = np.linalg.norm(normals, axis=1)
    # A triangle without area has no normal: what it is given deviates from all.
    unit = np.divide(normals, sizes[:, None], out=np.zeros_like(normals), where=sizes[:, None] > 0.0)
    starts = np.flatnonzero(np.diff(face_of, prepend=-1))
    counts = np.diff(np.append(starts, len(face_of)))
    means = np.add.reduceat(normals, starts)
    means /= np.maximum(np.linalg.norm(means, axis=1), 1e-300)[:, None]
    cosines = np.einsum("ij,ij->i", unit, np.repeat(means, counts, axis=0))
    # Within half the angle of the mean all lie within the angle of each other.
    folded = np.minimum.reduceat(cosines, starts) < _COSINE_OF_HALF
    for number in np.flatnonzero(folded):
        own = unit[starts[number] : starts[number] + counts[number]]
        folded[number] = (own @ own.T).min() < _LEAST_COSINE
    return folded
