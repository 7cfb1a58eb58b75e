"""Node `roof_selector`."""

from __future__ import annotations

from typing import Any

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.nodes.pool_node import PoolNode
from lidar_buildings.pipeline.tile_stages import roof_points, select_roof_points
from lidar_buildings.ros.errands import Turns


class RoofSelector(PoolNode):
    """Gives every point its final class."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("roof_selector", **kwargs)
        self._classified_points = self.create_tile_outlet("classified_points")
        self._roof_points = self.create_tile_outlet("roof_points")
        self.subscribe_tiles("ground_points", self.on_tile)

    def on_tile(self, tile: PointTile) -> Turns:
        """Classify one tile and hand its roofs on; let others come meanwhile."""
        answer = self._pool.submit(select_roof_points, tile, self.parameters[RoofSelectionConfig])
        yield answer
        classified = answer.result()
        self._roof_points.publish(tile.stamp, roof_points(classified))
        self._classified_points.publish(tile.stamp, classified)
