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
    """Return for each face whether it is folded, code 204; `face_of` names each triangle's face, rising."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    normals = cross(b - a, c - a)
    sizes = _lengths(normals)
    # A triangle without area has no normal: what it is given deviates from all.
    unit = np.divide(normals, sizes[:, None], out=np.zeros_like(normals), where=sizes[:, None] > 0.0)
    ends = (face_of[1:] > face_of[:-1]).nonzero()[0] + 1
    starts, ends = np.concatenate(([0], ends)), np.concatenate((ends, [len(face_of)]))
    means = np.add.reduceat(normals, starts)
    means /= np.maximum(_lengths(means), 1e-300)[:, None]
    cosines = np.einsum("ij,ij->i", unit, means.repeat(ends - starts, axis=0))
    # Within half the angle of the mean all lie within the angle of each other.
    folded = np.minimum.reduceat(cosines, starts) < _COSINE_OF_HALF
    for number in folded.nonzero()[0]:
        own = unit[starts[number] : ends[number]]
        folded[number] = (own @ own.T).min() < _LEAST_COSINE
    return folded


def _lengths(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.add.reduce(vectors * vectors, axis=1)))
