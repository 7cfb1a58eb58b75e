"""Which voxels have had a point, of a stream of points that never ends."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel

#: Voxels that are remembered (32 MB).
_N_SEEN = 2**22
#: Odd numbers that spread the columns, rows and layers of voxels over 64 bits (Steele, Lea, Flood, 2014).
#: Multiples are added: combined bit by bit, those of voxels that mirror one another are often the same.
_SPREAD = np.array([0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB], dtype=np.uint64).view(
    np.int64
)


class SeenVoxels:
    """Remembers the last some million voxels that had a point."""

    def __init__(self) -> None:
        self._keys = np.zeros(_N_SEEN, dtype=np.int64)

    def are_new(self, points: NDArray[np.float64], side: float) -> NDArray[np.bool_]:
        """Tell which points, shape (n, 3) [m], are the first of their voxels of a side [m], and remember."""
        is_new = np.zeros(len(points), dtype=np.bool_)
        _tell_new(points, side, self._keys, is_new)
        return is_new


@kernel
def _tell_new(points, side, keys, is_new):  # type: ignore[no-untyped-def]
    for i in range(len(points)):
        key = 0
        for axis in range(3):
            key += np.int64(math.floor(points[i, axis] / side)) * _SPREAD[axis]
        key |= 1
        slot = key % (len(keys) - 1)
        if keys[slot] != key:
            keys[slot], is_new[i] = key, True
