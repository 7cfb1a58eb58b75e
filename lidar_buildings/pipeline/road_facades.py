"""Façades that were published for places beside a vehicle's way, until a tile has them."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Collection, Iterable

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.stages.facades.facade import Facade
from lidar_buildings.pipeline.tile_facades import MappedFacades

#: How many are remembered: those of 1,000 km of streets. What was published longest ago stays where it was
#: shown.
_MOST = 100_000


class RoadFacades:
    """Remembers where façades of places stand, and which of them the next sending, or a tile, replaces."""

    def __init__(self) -> None:
        self._where: OrderedDict[int, tuple[float, float]] = OrderedDict()

    def add(self, facades: Iterable[Facade]) -> None:
        """Take the façades of a place."""
        for one in facades:
            seen = max((line for line, is_seen in one.stretches if is_seen), key=_length, default=one.foot)
            self._where[one.facade_id] = tuple((0.5 * (seen[:1] + seen[-1:])).ravel().tolist())
        while len(self._where) > _MOST:
            self._where.popitem(last=False)

    def replaced_at(self, points: NDArray[np.float64], ids: Collection[int]) -> list[int]:
        """Forget the façades where a place has points, and return those that are not among its `ids`."""
        squares = set(map(tuple, np.unique(np.floor(points[:, :2]), axis=0).tolist()))
        return self._forget(
            [number for number, (x, y) in self._where.items() if (x // 1.0, y // 1.0) in squares], ids
        )

    def replaced(self, found: MappedFacades, ids: Collection[int]) -> list[int]:
        """Forget the façades at a tile's place, and return those that are not among the tile's `ids`."""
        if (shown := found.wall_map) is None:
            return []
        height, width = (n * shown.resolution for n in shown.cells.shape)
        here = [
            number
            for number, (x, y) in self._where.items()
            if 0.0 <= x - shown.west <= width and 0.0 <= y - shown.south <= height
        ]
        return self._forget(here, ids)

    def _forget(self, here: Collection[int], ids: Collection[int]) -> list[int]:
        for number in here:
            del self._where[number]
        return sorted(set(here).difference(ids))


def _length(line: NDArray[np.float64]) -> float:
    return float(np.hypot(*(line[-1] - line[0])))
