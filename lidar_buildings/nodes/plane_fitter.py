"""Node `plane_fitter`."""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any

from sensor_msgs.msg import PointCloud2

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.plane_fitting.config import PlaneFittingConfig
from lidar_buildings.nodes.configs import NODE_CONFIGS
from lidar_buildings.pipeline.tile_stages import fit_planes
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.qos import CLOUD
from lidar_buildings.ros.stage_node import StageNode


class PlaneFitter(StageNode):
    """Finds the planes of each building's roof."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("plane_fitter", NODE_CONFIGS["plane_fitter"], **kwargs)
        self._plane_points = self.create_output(PointCloud2, "plane_points", CLOUD)
        self.take_tiles(("building_points",), self.work, self.publish)
        self.subscribe_tiles("building_points")

    def work(self, tile: PointTile) -> Future[PointTile]:
        """Fit the planes of one tile's buildings."""
        return self.submit_shared(fit_planes, tile, self.parameters[PlaneFittingConfig])

    def publish(self, stamp: int, planes: PointTile) -> None:
        """Publish one tile's points with their planes."""
        self.summary.passed_on(len(planes))
        self._plane_points.publish(to_message(planes))
