"""
On which side points lie, decided in whole numbers.

Coordinates are whole multiples of a unit (see `whole_numbers`), so few that no product overflows 64 bits:
signs are exact.
"""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.solids.output_grid import GRID

#: Extent in units up to which six products of three differences fit in 64 bits.
_MAX_EXTENT = 1_100_000


def whole_numbers(vertices: FloatArray) -> IntArray:
    """Return coordinates in units: the output grid's for what lies on it, else the smallest that fits."""
    low = vertices.min(axis=0)
    extent = float(np.ptp(vertices, axis=0).max())
    on_grid = np.abs(vertices / GRID - np.rint(vertices / GRID)).max() < 1e-3
    if on_grid and extent / GRID <= _MAX_EXTENT:
        steps = np.rint(vertices / GRID)
        return (steps - steps.min(axis=0)).astype(np.int64)
    return np.rint((vertices - low) * (_MAX_EXTENT / max(extent, 1e-300))).astype(np.int64)


@kernel
def side_of_plane(p: IntArray, a: int, b: int, c: int, d: int) -> int:
    """Return the sign of the volume of a tetrahedron of rows: 0 if all lie in one plane."""
    ux, uy, uz = p[a, 0] - p[d, 0], p[a, 1] - p[d, 1], p[a, 2] - p[d, 2]
    vx, vy, vz = p[b, 0] - p[d, 0], p[b, 1] - p[d, 1], p[b, 2] - p[d, 2]
    wx, wy, wz = p[c, 0] - p[d, 0], p[c, 1] - p[d, 1], p[c, 2] - p[d, 2]
    return sign(ux * (vy * wz - vz * wy) + uy * (vz * wx - vx * wz) + uz * (vx * wy - vy * wx))


@kernel
def side_of_line(p: IntArray, a: int, b: int, c: int, dropped: int) -> int:
    """Return the sign of the area of a triangle of rows, seen along one axis."""
    i, j = (dropped + 1) % 3, (dropped + 2) % 3
    return sign((p[b, i] - p[a, i]) * (p[c, j] - p[a, j]) - (p[b, j] - p[a, j]) * (p[c, i] - p[a, i]))


@kernel
def steepest_axis(p: IntArray, a: int, b: int, c: int) -> int:
    """Return an axis along which a triangle of rows is seen with an area, −1 if it has none."""
    best, chosen = 0, -1
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        area = abs((p[b, i] - p[a, i]) * (p[c, j] - p[a, j]) - (p[b, j] - p[a, j]) * (p[c, i] - p[a, i]))
        if area > best:
            best, chosen = area, axis
    return chosen


@kernel
def sign(value: int) -> int:
    """Return −1, 0 or 1."""
    if value > 0:
        return 1
    return -1 if value < 0 else 0
