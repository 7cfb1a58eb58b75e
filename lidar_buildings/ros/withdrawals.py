"""What a tile's later revision no longer has, and must be withdrawn from those who listen."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable
from typing import Generic, TypeVar

from lidar_buildings.ros.stamps import tile_of

Key = TypeVar("Key", int, str)

#: How many buildings and tiles are remembered, in some 50 MB; wide margin: those of 100 km² of a town. What
#: belongs to the tiles that were published longest ago is forgotten, and stays where it was shown.
_MAX_BUILDINGS = 200_000


class Withdrawals(Generic[Key]):
    """Remembers which buildings each tile's last revision had."""

    def __init__(self) -> None:
        self._tiles: OrderedDict[int, tuple[int, frozenset[Key]]] = OrderedDict()
        #: Building → the tile that had it last: one that goes over to another tile is not withdrawn.
        self._owner: dict[Key, int] = {}

    def of(self, stamp: int, buildings: Iterable[Key]) -> list[Key]:
        """
        Return what a tile had in its revision before and has no more, in rising order.

        Of an earlier revision than the last one nothing is withdrawn or remembered.
        """
        tile, now = tile_of(stamp), frozenset(buildings)
        last, before = self._tiles.get(tile, (stamp, frozenset()))
        if stamp < last:
            return []
        gone = sorted(one for one in before - now if self._owner.get(one) == tile)
        for one in gone:
            del self._owner[one]
        self._owner.update(dict.fromkeys(now, tile))
        self._tiles[tile] = stamp, now
        self._tiles.move_to_end(tile)
        self._forget()
        return gone

    def _forget(self) -> None:
        while len(self._owner) + len(self._tiles) > _MAX_BUILDINGS and len(self._tiles) > 1:
            tile, (_, buildings) = self._tiles.popitem(last=False)
            for one in buildings:
                if self._owner.get(one) == tile:
                    del self._owner[one]
