"""How many points a tile of a feed may have: a slow or standing sensor measures the same places for ever."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.io.tiling.cell_table import Cell

#: Side of a voxel of a crowded tile, which takes one point [m]: no finer than a building's model needs.
VOXEL = 0.1
#: Share of the most points from which on a tile is crowded.
_CROWDED = 0.5
#: Voxels that are remembered, of all tiles together (32 MB).
_N_SEEN = 2**22
#: Odd numbers that spread the columns, rows and layers of voxels over 64 bits (Steele, Lea, Flood, 2014).
_SPREAD = np.array([0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB], dtype=np.uint64)
#: Why points are left out.
CROWDED = f"a tile has many points: one per {VOXEL} m is enough"
TOO_MANY = "a tile has more than max_tile_points"


class TileRoom:
    """
    Leaves out points of tiles that have many: of crowded ones those near others, of full ones all.

    `most` are the points of a tile that is full.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._crowded: set[Cell] = set()
        self._full: set[Cell] = set()
        self._seen = np.zeros(_N_SEEN, dtype=np.uint64)

    def note(self, place: Cell, n_points: int) -> None:
        """Note how many points a tile has."""
        if n_points >= self._most:
            self._full.add(place)
        elif n_points >= _CROWDED * self._most:
            self._crowded.add(place)

    def chosen(self, records: NDArray[Any], places: NDArray[np.int64]) -> tuple[NDArray[Any], Counter[str]]:
        """
        Return the records that are kept, and how many are not for which reason.

        `places` are column and row of each record's tile, shape (n, 2).
        """
        if not self._crowded and not self._full:
            return records, Counter()
        is_full, is_crowded = _are_in(places, self._full), _are_in(places, self._crowded)
        crowd = np.flatnonzero(is_crowded & ~is_full)
        is_kept = ~is_full
        is_kept[crowd] = self._are_new(records[crowd])
        left_out = {TOO_MANY: np.count_nonzero(is_full), CROWDED: np.count_nonzero(~is_kept & ~is_full)}
        return records.compress(is_kept), Counter({why: int(n) for why, n in left_out.items() if n})

    def _are_new(self, records: NDArray[Any]) -> NDArray[np.bool_]:
        """Tell which records are the first of their voxels, as far as these are remembered."""
        voxels = np.stack([np.floor(records[axis].astype(np.float64) / VOXEL) for axis in "xyz"], axis=1)
        keys = np.bitwise_xor.reduce(voxels.astype(np.int64).view(np.uint64) * _SPREAD, axis=1) | np.uint64(1)
        is_new = np.zeros(len(keys), dtype=bool)
        is_new[np.unique(keys, return_index=True)[1]] = True
        slots = keys % np.uint64(_N_SEEN - 1)
        is_new &= self._seen[slots] != keys
        self._seen[slots[is_new]] = keys[is_new]
        return is_new


def _are_in(places: NDArray[np.int64], chosen: set[Cell]) -> NDArray[np.bool_]:
    is_in = np.zeros(len(places), dtype=bool)
    for place in chosen:
        is_in |= (places == place).all(axis=1)
    return is_in
