"""Points that came before: tiles of ours that were sent again, or larger, name their points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import MessageError

#: Rows of a source that are remembered at first.
_FIRST = 1_000_000
#: Bytes that are taken at most: those of eight billion points.
_MOST = 1_000_000_000


class SeenPoints:
    """Remembers rows of sources, a bit each."""

    def __init__(self) -> None:
        self._seen: dict[int, NDArray[np.uint8]] = {}

    def are_new(self, source: NDArray[np.uint16], index: NDArray[np.uint32]) -> NDArray[np.bool_]:
        """
        Tell which points, by their input's number and row, were not asked for before; remember them.

        Each pair comes once, shape (n,). MessageError if the numbers are those of more points than any survey
        has.
        """
        is_new = np.zeros(len(source), dtype=bool)
        for number in np.unique(source):
            own = np.flatnonzero(source == number)
            rows = index[own].astype(np.int64)
            bits = self._bits(int(number), int(rows.max()))
            masks = np.uint8(1) << (rows & 7).astype(np.uint8)
            is_new[own] = (bits[rows >> 3] & masks) == 0
            np.bitwise_or.at(bits, rows >> 3, masks)
        return is_new

    def _bits(self, source: int, last: int) -> NDArray[np.uint8]:
        """Return the bits of a source, at least up to a row."""
        bits = self._seen.get(source, np.zeros(_FIRST // 8, np.uint8))
        if last // 8 >= len(bits):
            grown = np.zeros(max(2 * len(bits), last // 8 + 1), np.uint8)
            if sum(map(len, self._seen.values())) + len(grown) > _MOST:
                raise MessageError(f"point {last} of source {source}: no survey has so many points")
            grown[: len(bits)] = bits
            bits = grown
        self._seen[source] = bits
        return bits
