"""Node `ground_filter`."""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any

from sensor_msgs.msg import PointCloud2

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.terrain.config import RasterConfig
from lidar_buildings.nodes.configs import NODE_CONFIGS, GroundFilterNodeConfig
from lidar_buildings.pipeline.tile_stages import FilteredTile, filter_ground, rasterise_tile
from lidar_buildings.ros.point_cloud import grid_message, to_message
from lidar_buildings.ros.qos import CLOUD
from lidar_buildings.ros.stage_node import StageNode


class GroundFilter(StageNode):
    """Classifies the ground of each tile; holds one back that cuts off what may be a wide roof."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("ground_filter", NODE_CONFIGS["ground_filter"], **kwargs)
        self._ground_points = self.create_output(PointCloud2, "ground_points", CLOUD)
        self._dtm = None
        if self.parameters[GroundFilterNodeConfig].publish_dtm:
            self._dtm = self.create_publisher(PointCloud2, "dtm", CLOUD)
        self.take_tiles(("points",), self.work, self.publish, clipped=lambda filtered: filtered.clipped)
        self.subscribe_tiles("points")

    def work(self, tile: PointTile) -> Future[FilteredTile]:
        """Classify one tile."""
        return self.submit(filter_ground, tile, self.parameters[GroundFilterNodeConfig])

    def publish(self, stamp: int, filtered: FilteredTile) -> None:
        """Publish one tile's points, and its terrain on request."""
        self.summary.passed_on(len(filtered.tile))
        self._ground_points.publish(to_message(filtered.tile))
        if self._dtm is not None:
            resolution = self.parameters[GroundFilterNodeConfig].dtm_resolution
            rasters = rasterise_tile(filtered.tile, RasterConfig(raster_resolution=resolution), MapFrame())
            self._dtm.publish(grid_message(stamp, rasters.window, rasters.dtm))
