"""
Folds in faces: triangles of one face whose normals differ.

"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.validity.codes import MARGIN, MAX_NORMAL_DEVIATION_DEG

#: Cosine of the largest angle allowed between two triangles of a face.
_LEAST_COSINE = math.cos(math.radians(MAX_NORMAL_DEVIATION_DEG * (1.0 - MARGIN)))


def folds(
    vertices: NDArray[np.float64], triangles: NDArray[np.int64], face_of: NDArray[np.int64]
) -> NDArray[np.bool_]:
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
    normals = np.cross(b - a, c - a)
    sizes = np.linalg.norm(normals, axis=1)
    # A triangle without area has no normal: what it is given deviates from all.
    unit = np.divide(normals, sizes[:, None], out=np.zeros_like(normals), where=sizes[:, None] > 0.0)
    return _folded(unit, face_of)


@njit(cache=True, nogil=True)
def _folded(unit: NDArray[np.float64], face_of: NDArray[np.int64]) -> NDArray[np.bool_]:
    """
    Compare each triangle's normal with those of all others of its face.

    """
    folded = np.zeros(face_of[-1] + 1, dtype=np.bool_)
    for i in range(len(unit)):
        j = i - 1
        while j >= 0 and face_of[j] == face_of[i] and not folded[face_of[i]]:
            cosine = 0.0
            for axis in range(3):
                cosine += unit[i, axis] * unit[j, axis]
            if cosine < _LEAST_COSINE:
                folded[face_of[i]] = True
            j -= 1
    return folded
