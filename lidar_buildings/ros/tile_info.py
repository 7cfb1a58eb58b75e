"""What holds for a tile as a whole, beside its points: its limits, point spacing and limit of dark ground."""

from __future__ import annotations

import json
import math
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rclpy.node import Node
from std_msgs.msg import String

from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.model.sides import Bounds, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros.depths import CLOUD_DEPTH
from lidar_buildings.ros.json_text import read_json
from lidar_buildings.ros.letterbox import Letterbox
from lidar_buildings.ros.qos import LATCHED_TILE

TOPIC, CLIPPED = "tile_info", "tile_clipped"
_MEMBERS = ("bounds", "point_spacing", "dark_limit")
#: How many tiles are remembered: twice what the topic keeps, far more than are in flight.
_MAX_TILES = 2 * CLOUD_DEPTH
#: How often a tile may have come before its message; wide margin: on two topics, each a few times.
_MAX_WORKS = 8
#: After so long without any publisher of the topic nobody will tell of a tile that ought to be told of; wide
#: margin over the discovery of a node, and over the time that one needs to be started anew [s].
_PATIENCE = 20.0


def info_message(tile: PointTile) -> String:
    """Return a tile's stamp, bounds, spacing and dark limit as a line of JSON; null: not known, or none."""
    said = {name: getattr(tile, name) for name in _MEMBERS}
    if tile.bounds is not None:
        said["bounds"] = [limit if math.isfinite(limit) else None for limit in tile.bounds]
    return String(data=json.dumps({"stamp": tile.stamp, **said}))


def over_message(stamp: int) -> String:
    """Return the message that copies of a tile that are still under way are to be dropped."""
    return String(data=json.dumps({"stamp": stamp, "is_over": True}))


def info_of(message: String) -> tuple[int, dict[str, Any]]:
    """
    Return a tile's stamp [ns] and what is said of it.

    MessageError if the text is not of the form that `info_message` gives.
    """
    return read_json(TOPIC, message, lambda said: (int(said["stamp"]), dict(said)))


def clipped_message(stamp: int, sides: Sides) -> String:
    """Return the message that a building, or what may be one, reaches beyond some sides of a tile."""
    return String(data=json.dumps({"stamp": stamp, **sides._asdict()}))


def clipped_of(message: String) -> tuple[int, Sides]:
    """
    Return a tile's stamp [ns] and beyond which sides of it a building, or what may be one, reaches.

    MessageError if the text is not of the form that `clipped_message` gives.
    """
    return read_json(
        CLIPPED,
        message,
        lambda said: (int(said["stamp"]), Sides(*(bool(said[side]) for side in Sides._fields))),
    )


class TileInfos:
    """
    Remembers what the source said of its tiles, and holds work back that came before.

    Points that somebody else publishes come without: the stages then measure what they need. What comes from
    a source of ours has the column `index`, and is waited for even if its publisher cannot be seen: it may be
    discovered later than the points, or be started anew.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._known: OrderedDict[int, dict[str, Any]] = OrderedDict()
        self._waiting: OrderedDict[int, list[Callable[[], None]]] = OrderedDict()
        self._box = Letterbox(node, String, TOPIC, self.on_info, LATCHED_TILE, lambda: bool(self._waiting))

    def on_info(self, message: String) -> None:
        """
        Remember what is said of a tile, and go on with the work that waits for it.

        MessageError if the message is not understood.
        """
        stamp, info = info_of(message)
        self._known[stamp] = info
        self._known.move_to_end(stamp)
        _keep_last(self._known)
        for work in self._waiting.pop(stamp, ()):
            if not info.get("is_over"):
                work()

    def when_known(self, stamp: int, work: Callable[[], None], *, is_promised: bool) -> None:
        """
        Do the work on a tile now, or once the tile's message is there if somebody sends them.

        It is waited for if it is promised: the tile comes from a source that sends such messages. A tile of
        which the last message says that it is over is dropped.
        """
        if self.is_over(stamp):
            return
        is_told = self._node.count_publishers(TOPIC) > 0
        if stamp in self._known or not (is_told or is_promised):
            work()
            return
        self.when_told_more(stamp, work)
        if not is_told:
            self._expect(stamp)

    def when_told_more(self, stamp: int, work: Callable[[], None]) -> None:
        """Do the work when the next message of a tile comes."""
        works = self._waiting.setdefault(stamp, [])
        works.append(work)
        del works[:-_MAX_WORKS]
        _keep_last(self._waiting)

    def _expect(self, stamp: int) -> None:
        """Go on without a tile's message if after some time nobody is there who sends any."""

        def give_up() -> None:
            timer.cancel()
            if stamp in self._waiting and not self._node.count_publishers(TOPIC):
                self._node.get_logger().warning(
                    f"tile {stamp}: nobody publishes {TOPIC}: limits and spacing are measured from its points"
                )
                for work in self._waiting.pop(stamp):
                    work()

        timer = self._node.create_timer(_PATIENCE, give_up)

    def is_over(self, stamp: int) -> bool:
        """Whether the last message of a tile says that it is done with."""
        self._box.look()
        return bool(self._known.get(stamp, {}).get("is_over"))

    def is_all(self, stamp: int, sides: Sides) -> bool:
        """Whether the last message of a tile says that there is nothing beyond some sides of it."""
        try:
            bounds = _bounds_of(self._known.get(stamp, {}).get("bounds", (0.0,) * 4))
        except ValueError:
            return False
        return sides.opened(bounds) == bounds

    def complete(self, tile: PointTile) -> PointTile:
        """Return a tile with what is known of it; MessageError if a value is none that a tile can have."""
        info = self._known.get(tile.stamp, {})
        try:
            said = {name: info[name] for name in _MEMBERS if name in info}
            if "bounds" in said:
                said["bounds"] = _bounds_of(said["bounds"])
            return replace(tile, **said)
        except (TypeError, ValueError) as error:
            raise MessageError(f"{TOPIC} of tile {tile.stamp}: {error}") from None


def _bounds_of(said: Any) -> Bounds | None:
    """
    Return a tile's limits as they are said: null where there is none.

    ValueError if they are not four numbers or null.
    """
    if said is None:
        return None
    try:
        west, south, east, north = (0.0 if limit is None else float(limit) for limit in said)
    except (TypeError, ValueError):
        raise ValueError(
            f"bounds = {said!r}: must be four numbers, or null where there is no limit"
        ) from None
    return Sides(*(limit is None for limit in said)).opened((west, south, east, north))


def _keep_last(tiles: OrderedDict[int, Any]) -> None:
    while len(tiles) > _MAX_TILES:
        tiles.popitem(last=False)
