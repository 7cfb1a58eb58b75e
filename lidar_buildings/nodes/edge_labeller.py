"""Node `edge_labeller`."""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any

from sensor_msgs.msg import PointCloud2

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.nodes.configs import NODE_CONFIGS
from lidar_buildings.pipeline.tile_stages import LabelledTile, label_roof_edges
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.qos import CLOUD
from lidar_buildings.ros.stage_node import StageNode


class EdgeLabeller(StageNode):
    """Labels the roof points on edges."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("edge_labeller", NODE_CONFIGS["edge_labeller"], **kwargs)
        self._edge_points = self.create_output(PointCloud2, "edge_points", CLOUD)
        self.take_tiles(("roof_points",), self.work, self.publish)
        self.subscribe_tiles("roof_points")

    def work(self, tile: PointTile) -> Future[LabelledTile]:
        """Label one tile."""
        return self.submit(label_roof_edges, tile, self.parameters[EdgeLabellingConfig])

    def publish(self, stamp: int, labelled: LabelledTile) -> dict[str, int]:
        """Publish one tile's points; report how many of its roofs came to which status."""
        self.summary.passed_on(len(labelled.tile))
        self._edge_points.publish(to_message(labelled.tile))
        return {f"roofs_{status}": number for status, number in labelled.n_roofs.items()}
