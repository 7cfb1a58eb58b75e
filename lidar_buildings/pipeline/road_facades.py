"""Façades that were published for strips of a vehicle's way, until a tile has them."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Collection, Iterable

from lidar_buildings.core.stages.facades.facade import Facade
from lidar_buildings.pipeline.tile_facades import MappedFacades

#: How many are remembered: those of 1,000 km of streets. What was published longest ago stays where it was
#: shown.
_MOST = 100_000


class RoadFacades:
    """Remembers where façades of strips stand, and which of them a tile replaces."""

    def __init__(self) -> None:
        self._place: OrderedDict[int, tuple[float, float]] = OrderedDict()

    def add(self, facades: Iterable[Facade]) -> None:
        """Take the façades of a strip."""
        for one in facades:
            self._place[one.facade_id] = tuple(one.foot.mean(axis=0).tolist())
        while len(self._place) > _MOST:
            self._place.popitem(last=False)

    def replaced(self, found: MappedFacades, ids: Collection[int]) -> list[int]:
        """Forget the façades at a tile's place, and return those that are not among the tile's `ids`."""
        if (shown := found.wall_map) is None:
            return []
        height, width = (n * shown.resolution for n in shown.cells.shape)
        here = [
            number
            for number, (x, y) in self._place.items()
            if 0.0 <= x - shown.west <= width and 0.0 <= y - shown.south <= height
        ]
        for number in here:
            del self._place[number]
        return sorted(set(here).difference(ids))
