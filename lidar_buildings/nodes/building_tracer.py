"""
Node `building_tracer`.

"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import replace
from typing import Any

from geometry_msgs.msg import PolygonInstanceStamped, PolygonStamped
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from lidar_buildings.core.boundary_tracing import BoundaryTracingConfig
from lidar_buildings.core.segmentation import SegmentationConfig
from lidar_buildings.core.tile import PointTile
from lidar_buildings.core.tile_stages import trace_buildings
from lidar_buildings.nodes.configs import NODE_CONFIGS
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.polygons import Bounds, bounds_of, outline_messages
from lidar_buildings.ros.qos import BUILDING, CLOUD, EVENT, LATCHED_TILE
from lidar_buildings.ros.runner import run_node
from lidar_buildings.ros.stage_node import StageNode
from lidar_buildings.ros.stamps import header_of

#: How many tiles' bounds are remembered; many more than can be in flight.
_MAX_BOUNDS = 64


class BuildingTracer(StageNode):
    """
    Traces the buildings of each tile; holds a tile back that cuts one of its buildings off.

    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("building_tracer", NODE_CONFIGS["building_tracer"], **kwargs)
        self._bounds: OrderedDict[int, Bounds | None] = OrderedDict()
        self._waiting: dict[int, PointTile] = {}
        self._building_points = self.create_publisher(PointCloud2, "building_points", CLOUD)
        self._traced = self.create_publisher(PolygonInstanceStamped, "traced_outlines", BUILDING)
        self._clipped = self.create_publisher(Header, "tile_clipped", EVENT)
        self.create_subscription(PolygonStamped, "tile_bounds", self.on_bounds, LATCHED_TILE)
        self.subscribe_tiles("edge_points", self.on_tile)

    def on_bounds(self, message: PolygonStamped) -> None:
        """
        Remember a tile's limits, and go on with a tile that came before them.

        """
        stamp, bounds = bounds_of(message)
        self._bounds[stamp] = bounds
        self._bounds.move_to_end(stamp)
        while len(self._bounds) > _MAX_BOUNDS:
            self._bounds.popitem(last=False)
        if stamp in self._waiting:
            with self.reporting(stamp) as report:
                tile = self._waiting.pop(stamp)
                report.n_points = len(tile)
                self.on_tile(tile)

    def on_tile(self, tile: PointTile) -> None:
        """
        Trace one tile's buildings, or ask for more of the tile.

        """
        if tile.stamp not in self._bounds and self.count_publishers("tile_bounds"):
            self._waiting[tile.stamp] = tile
            return
        bounded = replace(tile, bounds=self._bounds.get(tile.stamp))
        traced = trace_buildings(
            bounded, self.parameters[SegmentationConfig], self.parameters[BoundaryTracingConfig]
        )
        if traced.clipped and self._clipped.get_subscription_count():
            self._clipped.publish(header_of(tile.stamp))
            return
        self._building_points.publish(to_message(traced.tile))
        self.publish_rings(self._traced, outline_messages(tile.stamp, traced.outlines))


def main() -> int:
    """
    Run the node.

    """
    return run_node(BuildingTracer)


if __name__ == "__main__":
    raise SystemExit(main())
