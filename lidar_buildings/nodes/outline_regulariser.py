"""Node `outline_regulariser`."""

from __future__ import annotations

from typing import Any

from std_msgs.msg import String

from lidar_buildings.core.stages.regularisation.config import RegularisationConfig
from lidar_buildings.nodes.pool_node import PoolNode
from lidar_buildings.pipeline.tile_outlines import regularise_outlines
from lidar_buildings.ros.outline_quality import quality_message
from lidar_buildings.ros.polygons import Rings, outline_rings
from lidar_buildings.ros.qos import CLOUD
from lidar_buildings.ros.ring_collector import outlines_of
from lidar_buildings.ros.withdrawals import Withdrawals


class OutlineRegulariser(PoolNode):
    """Regularises the outlines of each tile, and withdraws those that a tile has no more."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("outline_regulariser", **kwargs)
        self._withdrawals: Withdrawals[int] = Withdrawals()
        self._outlines = self.create_ring_outlet("outlines")
        self._quality = self.create_message_outlet(String, "outline_quality", CLOUD)
        self.subscribe_rings("traced_outlines", self.on_rings)

    def on_rings(self, stamp: int, rings: Rings) -> None:
        """Regularise one tile's outlines."""
        outlines = regularise_outlines(outlines_of(rings), self.parameters[RegularisationConfig], self._pool)
        gone = self._withdrawals.of(stamp, (one.building_id for one in outlines))
        self._quality.publish(stamp, [quality_message(stamp, outlines)])
        self._outlines.publish(stamp, {**dict.fromkeys(gone, ()), **outline_rings(outlines)})
        self.summary.count_buildings(one.quality.status.value for one in outlines)
