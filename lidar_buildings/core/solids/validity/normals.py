"""Folds in faces: triangles of one face whose normals differ."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.solids.validity.codes import MARGIN, MAX_NORMAL_DEVIATION_DEG

#: Largest angle allowed between two triangles of a face [rad].
_MAX_ANGLE = math.radians(MAX_NORMAL_DEVIATION_DEG * (1.0 - MARGIN))
_LEAST_COSINE = math.cos(_MAX_ANGLE)
_COSINE_OF_HALF = math.cos(0.5 * _MAX_ANGLE)


@kernel
def folds(vertices, triangles, face_of):  # type: ignore[no-untyped-def]
    """Return for each face whether it is folded, code 204; `face_of` names each triangle's face, rising."""
    unit, folded, n, first = np.zeros((len(triangles), 3)), np.zeros(len(triangles), np.bool_), 0, 0
    while first < len(triangles):
        last, x, y, z = first, 0.0, 0.0, 0.0
        while last < len(triangles) and face_of[last] == face_of[first]:
            a, b, c = triangles[last]
            ux, vx = vertices[b, 0] - vertices[a, 0], vertices[c, 0] - vertices[a, 0]
            uy, vy = vertices[b, 1] - vertices[a, 1], vertices[c, 1] - vertices[a, 1]
            uz, vz = vertices[b, 2] - vertices[a, 2], vertices[c, 2] - vertices[a, 2]
            nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            x, y, z = x + nx, y + ny, z + nz
            size = math.sqrt(nx * nx + ny * ny + nz * nz)
            # A triangle without area has no normal: what it is given deviates from all.
            if size > 0.0:
                unit[last, 0], unit[last, 1], unit[last, 2] = nx / size, ny / size, nz / size
            last += 1
        size, least = max(math.sqrt(x * x + y * y + z * z), 1e-300), 1.0
        for k in range(first, last):
            least = min(least, (unit[k, 0] * x + unit[k, 1] * y + unit[k, 2] * z) / size)
        # Within half the angle of the mean all lie within the angle of each other.
        if least < _COSINE_OF_HALF:
            for k in range(first, last):
                for m in range(first, k + 1):
                    cosine = unit[k, 0] * unit[m, 0] + unit[k, 1] * unit[m, 1] + unit[k, 2] * unit[m, 2]
                    folded[n] |= cosine < _LEAST_COSINE
        n, first = n + 1, last
    return folded[:n]
