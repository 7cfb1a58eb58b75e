"""Node `roof_selector`."""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any

from sensor_msgs.msg import PointCloud2

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.nodes.configs import NODE_CONFIGS
from lidar_buildings.pipeline.tile_stages import roof_points, select_roof_points
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.qos import CLOUD
from lidar_buildings.ros.stage_node import StageNode


class RoofSelector(StageNode):
    """Gives every point its final class."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("roof_selector", NODE_CONFIGS["roof_selector"], **kwargs)
        self._classified_points = self.create_output(PointCloud2, "classified_points", CLOUD)
        self._roof_points = self.create_output(PointCloud2, "roof_points", CLOUD)
        self.take_tiles(("ground_points",), self.work, self.publish)
        self.subscribe_tiles("ground_points")

    def work(self, tile: PointTile) -> Future[PointTile]:
        """Classify one tile."""
        return self.submit(select_roof_points, tile, self.parameters[RoofSelectionConfig])

    def publish(self, stamp: int, classified: PointTile) -> None:
        """Publish one tile's points, and its roofs apart."""
        self.summary.passed_on(len(classified))
        self._roof_points.publish(to_message(roof_points(classified)))
        self._classified_points.publish(to_message(classified))
