"""Node `ground_filter`."""

from __future__ import annotations

from typing import Any

from sensor_msgs.msg import PointCloud2

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.terrain.config import RasterConfig
from lidar_buildings.nodes.configs import GroundFilterNodeConfig
from lidar_buildings.nodes.pool_node import PoolNode
from lidar_buildings.pipeline.tile_rasters import rasterise_tile
from lidar_buildings.pipeline.tile_stages import filter_ground
from lidar_buildings.ros.clipped_tiles import ClippedTiles
from lidar_buildings.ros.errands import Turns
from lidar_buildings.ros.point_cloud import grid_message
from lidar_buildings.ros.qos import CLOUD


class GroundFilter(PoolNode):
    """Classifies the ground of each tile; holds one back that cuts off what may be a wide roof."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("ground_filter", **kwargs)
        self._ground_points = self.create_tile_outlet("ground_points")
        self._dtm = None
        if self.parameters[GroundFilterNodeConfig].publish_dtm:
            self._dtm = self.create_publisher(PointCloud2, "dtm", CLOUD)
        self.subscribe_tiles("points", self.on_tile)
        self._clipped = ClippedTiles(self)

    def on_tile(self, tile: PointTile) -> Turns:
        """Classify one tile, and let others come meanwhile."""
        answer = self._pool.submit(filter_ground, tile, self.parameters[GroundFilterNodeConfig])
        yield answer
        filtered = answer.result()
        self._clipped.hand_on(tile.stamp, filtered.clipped, lambda: self._hand_on(filtered.tile))

    def _hand_on(self, classified: PointTile) -> None:
        self._ground_points.publish(classified.stamp, classified)
        if self._dtm is not None:
            self._publish_dtm(classified)

    def _publish_dtm(self, classified: PointTile) -> None:
        """Publish one tile's terrain, its cells aligned in the map frame."""
        resolution = self.parameters[GroundFilterNodeConfig].dtm_resolution
        rasters = rasterise_tile(classified, RasterConfig(raster_resolution=resolution), MapFrame())
        self._dtm.publish(grid_message(classified.stamp, rasters.window, rasters.dtm))
