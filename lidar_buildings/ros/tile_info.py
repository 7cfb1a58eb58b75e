"""What holds for a tile as a whole, beside its points: its limits, point spacing and limit of dark ground."""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rclpy.node import Node
from std_msgs.msg import String

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros.depths import CLOUD_DEPTH
from lidar_buildings.ros.errors import MessageError
from lidar_buildings.ros.qos import LATCHED_TILE

TOPIC = "tile_info"
_MEMBERS = ("bounds", "point_spacing", "dark_limit")
#: How many tiles are remembered: twice what the topic keeps, far more than are in flight.
_MAX_TILES = 2 * CLOUD_DEPTH


def info_message(tile: PointTile) -> String:
    """Return a tile's stamp, bounds, point spacing and dark limit as a line of JSON; null = not known."""
    return String(data=json.dumps({"stamp": tile.stamp, **{name: getattr(tile, name) for name in _MEMBERS}}))


def over_message(stamp: int) -> String:
    """Return the message that copies of a tile that are still under way are to be dropped."""
    return String(data=json.dumps({"stamp": stamp, "is_over": True}))


class TileInfos:
    """
    Remembers what the source said of its tiles, and holds work back that came before.

    Where nobody publishes the topic, nothing is waited for: the stages then measure what they need.

    Parameters
    ----------
    node : Node
        Who listens.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._known: OrderedDict[int, dict[str, Any]] = OrderedDict()
        self._waiting: OrderedDict[int, list[Callable[[], None]]] = OrderedDict()
        node.create_subscription(String, TOPIC, self.on_info, LATCHED_TILE)

    def on_info(self, message: String) -> None:
        """Remember what is said of a tile, and go on with the work that waits for it."""
        try:
            info = json.loads(message.data)
            stamp = int(info["stamp"])
        except (ValueError, TypeError, KeyError):
            self._node.get_logger().error(f"{TOPIC}: not understood: {message.data[:100]}")
            return
        self._known[stamp] = info
        self._known.move_to_end(stamp)
        _keep_last(self._known)
        for work in self._waiting.pop(stamp, ()):
            if not info.get("is_over"):
                work()

    def when_known(self, stamp: int, work: Callable[[], None]) -> None:
        """
        Do the work on a tile now, or once the tile's message is there if somebody sends them.

        A tile of which the last message says that it is over is dropped.
        """
        if self.is_over(stamp):
            return
        if stamp in self._known or not self._node.count_publishers(TOPIC):
            work()
        else:
            self.when_told_more(stamp, work)

    def when_told_more(self, stamp: int, work: Callable[[], None]) -> None:
        """Do the work when the next message of a tile comes."""
        self._waiting.setdefault(stamp, []).append(work)
        _keep_last(self._waiting)

    def is_over(self, stamp: int) -> bool:
        """Whether the last message of a tile says that it is done with."""
        return bool(self._known.get(stamp, {}).get("is_over"))

    def is_whole(self, stamp: int) -> bool:
        """Whether the last message of a tile says that there is nothing beyond it."""
        return self._known.get(stamp, {}).get("bounds", ()) is None

    def complete(self, tile: PointTile) -> PointTile:
        """
        Return a tile with what is known of it.

        Raises
        ------
        MessageError
            If a value is none that a tile can have.
        """
        info = self._known.get(tile.stamp, {})
        try:
            return replace(tile, **{name: info[name] for name in _MEMBERS if name in info})
        except (TypeError, ValueError) as error:
            raise MessageError(f"{TOPIC} of tile {tile.stamp}: {error}") from None


def _keep_last(tiles: OrderedDict[int, Any]) -> None:
    while len(tiles) > _MAX_TILES:
        tiles.popitem(last=False)
