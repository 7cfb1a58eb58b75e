"""Which tiles the source has in flight, and what holds for each as a whole: limits, spacing, dark ground."""

from __future__ import annotations

import json
import math
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

from rclpy.node import Node
from std_msgs.msg import String

from lidar_buildings.core.model.bounds import checked_length, checked_stamp
from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.model.sides import NONE, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros.depths import CLOUD_DEPTH
from lidar_buildings.ros.qos import LATCHED, SILENT_SUBSCRIPTION
from lidar_buildings.ros.stamps import tile_of
from lidar_buildings.ros.text_messages import read_json

TOPIC = "tile_info"
_MEMBERS = ("bounds", "point_spacing", "dark_limit")
_OUTMOST = (-math.inf, -math.inf, math.inf, math.inf)
#: How many tiles are remembered; wide margin: at most 8 are in flight.
_MAX_TILES = 4 * CLOUD_DEPTH
#: After so long without a publisher nobody will tell of a tile; wide margin over discovery and restarts [s].
_PATIENCE = 20.0


def info_message(*tiles: PointTile, adopted: Iterable[int] = (), life: str = "") -> String:
    """
    Return the tiles in flight as JSON: stamp, bounds, spacing and dark limit; null: not known, or none.

    Of those adopted from an earlier life of the source only the stamp is told. A source without a life does
    not wait for its tiles: none of them is ever over.
    """
    found: list[dict[str, Any]] = [{"stamp": stamp} for stamp in adopted]
    for tile in tiles:
        said = {"stamp": tile.stamp, **{name: getattr(tile, name) for name in _MEMBERS}}
        if tile.bounds is not None:
            said["bounds"] = [limit if math.isfinite(limit) else None for limit in tile.bounds]
        found.append(said)
    return String(data=json.dumps({"life": life, "tiles": found}))


def infos_of(message: String) -> tuple[str, dict[int, dict[str, Any]]]:
    """Return the source's life, and what it says of each tile by stamp; MessageError if it is not clear."""

    def read(said: Any) -> tuple[str, dict[int, dict[str, Any]]]:
        tiles = {
            checked_stamp(one["stamp"]): {name: one[name] for name in _MEMBERS if name in one}
            for one in said["tiles"]
        }
        for info in tiles.values():
            if info.get("bounds") is not None:
                west, south, east, north = (
                    none if limit is None else checked_length("a limit", limit)
                    for none, limit in zip(_OUTMOST, info["bounds"], strict=True)
                )
                info["bounds"] = NONE.opened((west, south, east, north))
        return str(said["life"]), tiles

    return read_json(TOPIC, message, read)


class TileInfos:
    """
    Remembers what the source said of its tiles; `on_change` is called when it says something new.

    Points that somebody else publishes come without: the stages then measure what they need. What comes from
    a source of ours has the column `index`, and is waited for even if its publisher cannot be seen: it may be
    discovered later than the points, or be started anew.
    """

    def __init__(self, node: Node, on_change: Callable[[], None]) -> None:
        self._node, self._on_change = node, on_change
        self._known: OrderedDict[int, dict[str, Any]] = OrderedDict()  # stamp → what was said of the tile
        #: The source's life, what it has in flight, and what it has had.
        self._life, self._listed, self._had = "", set[int](), set[int]()
        self._seen = time.monotonic()  # when a publisher of the topic was there last
        node.create_subscription(String, TOPIC, self.on_info, LATCHED, event_callbacks=SILENT_SUBSCRIPTION)

    def on_info(self, message: String) -> None:
        """Take what the source says; MessageError if it is not understood."""
        life, said = infos_of(message)
        if life != self._life:
            self._life, self._had = life, set()
        self._listed = {*said}
        self._had |= self._listed
        for stamp, info in said.items():
            if info:
                self._known[stamp] = info
                self._known.move_to_end(stamp)
        while len(self._known) > _MAX_TILES:
            self._known.popitem(last=False)
        self._on_change()

    def is_known(self, stamp: int, *, is_promised: bool) -> bool:
        """
        Whether a tile's work may begin: what holds for it has been said, or nobody says such things.

        It is waited for if it is promised: the tile comes from a source that sends such messages.
        """
        if stamp in self._known:
            return True
        if self._node.count_publishers(TOPIC) > 0:
            self._seen = time.monotonic()
            return False
        if not is_promised:
            return True
        if time.monotonic() - self._seen < _PATIENCE:
            return False
        text = f"tile {stamp}: {TOPIC} has no publisher: limits and spacing are measured from its points"
        self._node.get_logger().warning(text)
        return True

    def is_over(self, stamp: int) -> bool:
        """Whether a revision of a tile is no longer in flight: it is done, or there is a later one."""
        if any(one > stamp and tile_of(one) == tile_of(stamp) for one in self._listed):
            return True
        return self._life != "" and stamp in self._had - self._listed

    def can_grow(self, stamp: int, sides: Sides) -> bool:
        """Whether the source may have points beyond some sides of a tile."""
        bounds = self._known.get(stamp, {}).get("bounds")
        return stamp in self._listed and sides.opened(bounds) != bounds

    def complete(self, tile: PointTile) -> PointTile:
        """Return a tile with what is known of it; MessageError if a value is none that a tile can have."""
        return completed(tile, self._known.get(tile.stamp, {}))


def completed(tile: PointTile, info: Mapping[str, Any]) -> PointTile:
    """Return a tile with what was said of it; MessageError if a value is none that a tile can have."""
    try:
        return replace(tile, **info)
    except (TypeError, ValueError, OverflowError) as error:
        raise MessageError(f"{TOPIC} of tile {tile.stamp}: {error}") from None
