"""The parts of a tile that several topics carry, joined by stamp."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from lidar_buildings.core.model.ids import tile_of
from lidar_buildings.core.model.tile import PointTile

#: How many tiles may be incomplete: those in flight (at most 8), and copies sent again.
MAX_INCOMPLETE_TILES = 16
#: Topic → what it carried of a tile.
Parts = dict[str, Any]


class TileJoin:
    """
    Joins the parts of a tile that several topics carry.

    A part that comes again replaces the earlier one, so a tile that was sent again completes what a restart
    has left incomplete. The first part of a later revision takes the place of all that was there. `fits`
    says whether parts that are all there belong together; they wait for better parts if not.
    """

    def __init__(self, topics: Iterable[str], fits: Callable[[Parts], bool] = lambda parts: True) -> None:
        self.topics = tuple(topics)
        self._fits = fits
        self._tiles: OrderedDict[int, Parts] = OrderedDict()

    def add(self, stamp: int, topic: str, part: Any) -> None:
        """Take one part; that of an earlier revision than the last one is dropped."""
        same = [one for one in self._tiles if tile_of(one) == tile_of(stamp)]
        if any(one > stamp for one in same):
            return
        for other in {*same} - {stamp}:
            del self._tiles[other]
        self._tiles.setdefault(stamp, {})[topic] = part
        while len(self._tiles) > MAX_INCOMPLETE_TILES:
            self._tiles.popitem(last=False)

    def stamps(self) -> list[int]:
        """Return the tiles that wait, the first that came first."""
        return list(self._tiles)

    def parts(self, stamp: int) -> Parts:
        """Return the parts of a tile that are there."""
        return self._tiles.get(stamp, {})

    def missing(self, stamp: int) -> set[str]:
        """Return which topics have still to carry their part of a tile; all, if the parts do not fit."""
        parts = self.parts(stamp)
        missing = {*self.topics} - parts.keys()
        return missing if missing or self._fits(parts) else {*self.topics}

    def take(self, stamp: int) -> Parts:
        """Remove a tile and return its parts."""
        return self._tiles.pop(stamp, {})


def agree_on_buildings(parts: Parts) -> bool:
    """
    Whether all outlines of a tile are of the same buildings, and its points of no others.

    They are not where a node was restarted in the middle of a tile and missed its first rings. A building
    may have no point: a footprint that was given.
    """
    outlined = [set(part) for part in parts.values() if isinstance(part, dict)]  # of qualities
    outlined += [{one.building_id for one in part} for part in parts.values() if isinstance(part, tuple)]
    ids = [part.building_id for part in parts.values() if isinstance(part, PointTile)]
    found = {int(number) for one in ids if one is not None for number in np.unique(one)} - {0}
    return not outlined or (all(one == outlined[0] for one in outlined) and found <= outlined[0])
