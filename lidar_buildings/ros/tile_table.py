"""What a node has of each tile, in one table: the parts that have come, its state, and its result."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lidar_buildings.core.model.ids import tile_of
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros.node_state import IN_HAND, WAITING, TileState

#: How many tiles a node remembers; wide margin: at most 8 are in flight.
MAX_TILES = 32
#: Topic → what it carried of a tile.
Parts = dict[str, Any]
_NEW = TileState(WAITING)


@dataclass
class TileEntry:
    """A tile, in one revision."""

    stamp: int
    state: TileState = _NEW
    parts: Parts = field(default_factory=dict)  #: that have come since the work on it began, if it did
    warnings: list[str] = field(default_factory=list)  #: what was wrong with them
    held: Any = None  #: its result, as long as the tile may come larger


class TileTable:
    """
    A node's tiles, those first of which nothing has changed for longest.

    The first part of a later revision takes the place of what was there, unless that is in hand. A part that
    comes again replaces the earlier one, so a tile that was sent again completes what a restart has left
    incomplete.
    """

    def __init__(self) -> None:
        self._tiles: dict[int, TileEntry] = {}

    def __iter__(self) -> Iterator[TileEntry]:
        return iter(list(self._tiles.values()))

    @property
    def in_hand(self) -> list[int]:
        """The tiles that are worked on."""
        return [one.stamp for one in self if one.state.status == IN_HAND]

    def entry(self, stamp: int) -> TileEntry | None:
        """Return a tile's entry, a new one if there is none; None if parts of a later revision are there."""
        if stamp in self._tiles:
            return self._tiles[stamp]
        same = [one for one in self if tile_of(one.stamp) == tile_of(stamp)]
        if any(one.stamp > stamp and one.parts for one in same):
            return None
        for one in same:
            if one.stamp < stamp:
                self.drop(one)
        idle = (one for one in self if one.state.status != IN_HAND)
        first = sorted(idle, key=lambda one: one.state.status == WAITING)  # what was passed on
        for one in first[: max(0, len(self._tiles) - MAX_TILES + 1)]:
            self.drop(one)
        self._tiles[stamp] = TileEntry(stamp)
        return self._tiles[stamp]

    def set(self, entry: TileEntry, state: TileState) -> bool:
        """Note what the node has of a tile; return whether that is new."""
        is_new = entry.state != state
        if is_new:
            entry.state = state
            self._tiles[entry.stamp] = self._tiles.pop(entry.stamp, entry)
        return is_new

    def drop(self, entry: TileEntry) -> bool:
        """Forget a tile, unless it is in hand; return whether it was forgotten."""
        return entry.state.status != IN_HAND and self._tiles.pop(entry.stamp, None) is not None


def agree_on_buildings(parts: Parts) -> bool:
    """
    Whether all outlines of a tile are of the same buildings, and its points of no others.

    They are not where a node was restarted in the middle of a tile and missed its first rings. A building
    may have no point: a footprint that was given.
    """
    outlined = [set(part) for part in parts.values() if isinstance(part, dict)]  # of qualities
    outlines = (part for topic, part in parts.items() if topic.endswith("outlines"))
    outlined += [{one.building_id for one in part} for part in outlines]
    ids = [part.building_id for part in parts.values() if isinstance(part, PointTile)]
    found = {int(number) for one in ids if one is not None for number in np.unique(one)} - {0}
    return not outlined or (all(one == outlined[0] for one in outlined) and found <= outlined[0])
