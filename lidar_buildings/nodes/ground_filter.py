"""
Node `ground_filter`.

"""

from __future__ import annotations

from typing import Any

from sensor_msgs.msg import PointCloud2

from lidar_buildings.core.ground_filter import GroundFilterConfig
from lidar_buildings.core.tile import PointTile
from lidar_buildings.core.tile_stages import filter_ground
from lidar_buildings.nodes.configs import NODE_CONFIGS
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.qos import CLOUD
from lidar_buildings.ros.runner import run_node
from lidar_buildings.ros.stage_node import StageNode


class GroundFilter(StageNode):
    """
    Classifies the ground of each tile.

    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("ground_filter", NODE_CONFIGS["ground_filter"], **kwargs)
        self._ground_points = self.create_publisher(PointCloud2, "ground_points", CLOUD)
        self.subscribe_tiles("points", self.on_tile)

    def on_tile(self, tile: PointTile) -> None:
        """
        Classify one tile.

        """
        self._ground_points.publish(to_message(filter_ground(tile, self.parameters[GroundFilterConfig])))


def main() -> int:
    """
    Run the node.

    """
    return run_node(GroundFilter)


if __name__ == "__main__":
    raise SystemExit(main())
