"""What a tile's later revision no longer has, and must be withdrawn from those who listen."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable
from typing import Any

from lidar_buildings.core.model.ids import tile_of

#: How many buildings are remembered, in some 50 MB; wide margin: those of 100 km² of a town. What belongs to
#: the tiles that were published longest ago is forgotten, and stays where it was shown.
_MAX_BUILDINGS = 200_000


class Withdrawals:
    """Remembers which buildings, by number or by name, each tile's last revision had."""

    def __init__(self) -> None:
        self._last: dict[int, int] = {}  #: tile → its last revision
        #: Building → the tile that had it last: one that goes over to another tile is not withdrawn.
        self._owner: OrderedDict[Any, int] = OrderedDict()

    def of(self, stamp: int, buildings: Iterable[Any]) -> list[Any]:
        """
        Return what a tile had in its revision before and has no more, in rising order.

        Of an earlier revision than the last one nothing is withdrawn or remembered.
        """
        tile, now = tile_of(stamp), set(buildings)
        if stamp < self._last.get(tile, stamp):
            return []
        self._last[tile] = stamp
        gone = sorted(one for one, owner in self._owner.items() if owner == tile and one not in now)
        for one in (*gone, *now):
            self._owner.pop(one, None)
        self._owner.update(dict.fromkeys(now, tile))
        while len(self._owner) > _MAX_BUILDINGS:
            self._owner.popitem(last=False)
        return gone
