"""Node `roof_selector`."""

from __future__ import annotations

from typing import Any

from sensor_msgs.msg import PointCloud2

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.roof_selection import RoofSelectionConfig
from lidar_buildings.nodes.configs import NODE_CONFIGS
from lidar_buildings.pipeline.tile_stages import roof_points, select_roof_points
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.qos import CLOUD
from lidar_buildings.ros.runner import run_node
from lidar_buildings.ros.stage_node import StageNode


class RoofSelector(StageNode):
    """Gives every point its final class."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("roof_selector", NODE_CONFIGS["roof_selector"], **kwargs)
        self._classified_points = self.create_publisher(PointCloud2, "classified_points", CLOUD)
        self._roof_points = self.create_publisher(PointCloud2, "roof_points", CLOUD)
        self.subscribe_tiles("ground_points", self.on_tile)

    def on_tile(self, tile: PointTile) -> None:
        """Classify one tile and hand its roofs on."""
        classified = select_roof_points(tile, self.parameters[RoofSelectionConfig])
        self._roof_points.publish(to_message(roof_points(classified)))
        self._classified_points.publish(to_message(classified))


def main() -> int:
    """Run the node."""
    return run_node(RoofSelector)


if __name__ == "__main__":
    raise SystemExit(main())
