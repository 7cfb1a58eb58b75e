"""Tiles that end in the middle of a building: the source is asked for more of them."""

from __future__ import annotations

from collections.abc import Callable

from std_msgs.msg import String

from lidar_buildings.core.model.sides import Sides
from lidar_buildings.ros.qos import EVENT
from lidar_buildings.ros.stage_node import StageNode
from lidar_buildings.ros.tile_info import CLIPPED, clipped_message


class ClippedTiles:
    """Holds the results of such tiles back, of a node that has called `subscribe_tiles` before."""

    def __init__(self, node: StageNode) -> None:
        self._node, self._infos = node, node.tile_infos
        self._clipped = node.create_publisher(String, CLIPPED, EVENT)

    def hand_on(self, stamp: int, sides: Sides, work: Callable[[], object]) -> None:
        """
        Do the work that hands a tile on: if it is whole, or there is nothing more of it beyond `sides`.

        If there is, a larger revision of the tile comes in its place.
        """
        if not sides or not self._clipped.get_subscription_count():
            work()
            return

        def go_on() -> None:
            if self._infos.is_all(stamp, sides):
                with self._node.reporting(stamp):
                    work()

        self._clipped.publish(clipped_message(stamp, sides))
        self._infos.when_told_more(stamp, go_on)
