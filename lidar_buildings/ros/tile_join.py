"""The parts of a tile that several topics carry, joined by stamp."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros.stamps import tile_of

#: How many tiles may be incomplete: those in flight (at most 8), and copies sent again.
MAX_INCOMPLETE_TILES = 16
#: Topic → what it carried of a tile.
Parts = dict[str, Any]


class TileJoin:
    """
    Joins the parts of a tile that several topics carry, and holds it back until it can be worked on.

    A part that comes again replaces the earlier one, so a tile that was sent again completes what a restart
    has left incomplete. The first part of a later revision takes the place of all that was there. `fits`
    tells whether parts that are all there belong together; they wait for a better part if not. `is_ready`
    tells whether what a complete tile needs beside its parts is there.
    """

    def __init__(
        self,
        topics: Iterable[str],
        fits: Callable[[Parts], bool] = lambda parts: True,
        is_ready: Callable[[int, Parts], bool] = lambda stamp, parts: True,
    ) -> None:
        self._topics = frozenset(topics)
        self._fits = fits
        self._is_ready = is_ready
        self._incomplete: OrderedDict[int, Parts] = OrderedDict()
        self._complete: OrderedDict[int, Parts] = OrderedDict()

    def add(self, stamp: int, topic: str, part: Any) -> Parts | None:
        """Take one part; return the tile's parts by topic if it is now complete and ready."""
        for held in (self._incomplete, self._complete):
            for other in [one for one in held if one < stamp and tile_of(one) == tile_of(stamp)]:
                del held[other]
        parts = self._incomplete.setdefault(stamp, {})
        parts[topic] = part
        if parts.keys() >= self._topics and self._fits(parts):
            del self._incomplete[stamp]
            if self._is_ready(stamp, parts):
                self._complete.pop(stamp, None)
                return parts
            self._complete[stamp] = parts
        for held in (self._incomplete, self._complete):
            while len(held) > MAX_INCOMPLETE_TILES:
                held.popitem(last=False)
        return None

    def part(self, stamp: int, topic: str) -> Any:
        """Return what a topic carried of a tile that is not complete, None if nothing."""
        return self._incomplete.get(stamp, {}).get(topic)

    def take_ready(self) -> Iterator[tuple[int, Parts]]:
        """
        Yield the stamps and parts of the complete tiles that have become ready.

        Whether one is ready is asked when those before it have been dealt with: they may have used what it
        needs.
        """
        for stamp, parts in list(self._complete.items()):
            if self._is_ready(stamp, parts):
                yield stamp, self._complete.pop(stamp)


def agree_on_buildings(parts: Parts) -> bool:
    """
    Whether all outlines of a tile are of the same buildings, and its points of no others.

    They are not where a node was restarted in the middle of a tile and missed its first rings. A building
    may have no point: a footprint that was given.
    """
    clouds = [_building_ids(part) for part in parts.values() if isinstance(part, PointTile)]
    rings = [_building_ids(part) for part in parts.values() if not isinstance(part, PointTile)]
    outlined = [ids for ids in rings if ids is not None]
    if any(ids != outlined[0] for ids in outlined):
        return False
    return all(ids is None or not outlined or ids <= outlined[0] for ids in clouds)


def _building_ids(part: Any) -> set[int] | None:
    """Return the buildings that a part names, None if it names none by its nature."""
    if isinstance(part, PointTile):
        return None if part.building_id is None else set(np.unique(part.building_id).tolist()) - {0}
    if isinstance(part, dict):  # of qualities
        return set(part)
    return {one.building_id for one in part} if isinstance(part, tuple) else None
