"""Node `outline_regulariser`."""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any

from geometry_msgs.msg import PolygonInstanceStamped
from std_msgs.msg import String

from lidar_buildings.core.model.outline import BuildingOutline
from lidar_buildings.core.stages.regularisation.config import RegularisationConfig
from lidar_buildings.nodes.configs import NODE_CONFIGS
from lidar_buildings.pipeline.tile_outlines import regularise_outlines
from lidar_buildings.ros.polygons import outline_rings, outlines_of, ring_messages
from lidar_buildings.ros.qos import CLOUD, MAP_RINGS
from lidar_buildings.ros.stage_node import StageNode, publish_all
from lidar_buildings.ros.text_messages import quality_message
from lidar_buildings.ros.withdrawals import Withdrawals

Outlines = tuple[BuildingOutline, ...]


class OutlineRegulariser(StageNode):
    """Regularises the outlines of each tile, and withdraws those that a tile has no more."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("outline_regulariser", NODE_CONFIGS["outline_regulariser"], **kwargs)
        self._withdrawals: Withdrawals[int] = Withdrawals()
        self._outlines = self.create_output(PolygonInstanceStamped, "outlines", MAP_RINGS)
        self._quality = self.create_output(String, "outline_quality", CLOUD)
        self.take_tiles(("traced_outlines",), self.work, self.publish)
        self.subscribe_rings("traced_outlines", outlines_of)

    def work(self, traced: Outlines) -> Future[Outlines]:
        """Regularise one tile's outlines."""
        return self.submit_shared(regularise_outlines, traced, self.parameters[RegularisationConfig])

    def publish(self, stamp: int, outlines: Outlines) -> None:
        """Publish one tile's outlines and how well they fit."""
        gone = self._withdrawals.of(stamp, (one.building_id for one in outlines))
        self._quality.publish(quality_message(stamp, outlines))
        publish_all(
            self._outlines, ring_messages(stamp, {**dict.fromkeys(gone, ()), **outline_rings(outlines)})
        )
        self.summary.passed_on(0)
        self.summary.count_buildings(one.quality.status.value for one in outlines)
