"""Node `building_tracer`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from geometry_msgs.msg import PointStamped, PolygonInstanceStamped, Vector3Stamped
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.boundary_tracing import BoundaryTracingConfig
from lidar_buildings.core.stages.edge_labelling import EdgeLabellingConfig
from lidar_buildings.core.stages.segmentation import SegmentationConfig
from lidar_buildings.io.vectors.footprints import FootprintSource, read_footprints
from lidar_buildings.nodes.configs import NODE_CONFIGS, FootprintNodeConfig
from lidar_buildings.pipeline.tile_stages import TracedTile, trace_buildings, trace_footprints
from lidar_buildings.ros.map_frames import frame_of
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.polygons import outline_messages
from lidar_buildings.ros.qos import BUILDING, CLOUD, EVENT, LATCHED
from lidar_buildings.ros.runner import run_node
from lidar_buildings.ros.stage_node import StageNode
from lidar_buildings.ros.stamps import header_of
from lidar_buildings.ros.tile_join import TileJoin, agree_on_roofs

_EDGES, _ALL = "edge_points", "classified_points"
#: Topic → what it said of a tile.
Parts = dict[str, PointTile]


class BuildingTracer(StageNode):
    """Traces the buildings of each tile, or takes given footprints; holds a tile back that cuts one off."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("building_tracer", NODE_CONFIGS["building_tracer"], **kwargs)
        self._waiting: dict[int, Parts] = {}
        self._origin: PointStamped | None = None
        self._units: Vector3Stamped | None = None
        self._has_footprints = bool(self.parameters[FootprintNodeConfig].file)
        self._join = TileJoin((_EDGES, _ALL) if self._has_footprints else (_EDGES,), _are_of_one_sending)
        self._building_points = self.create_publisher(PointCloud2, "building_points", CLOUD)
        self._traced = self.create_publisher(PolygonInstanceStamped, "traced_outlines", BUILDING)
        self._clipped = self.create_publisher(Header, "tile_clipped", EVENT)
        if self._has_footprints:
            self.create_subscription(Vector3Stamped, "map_units", self.on_units, LATCHED)
            self.create_subscription(PointStamped, "map_origin", self.on_origin, LATCHED)
            self.subscribe_tiles(_ALL, lambda tile: self.on_tile(_ALL, tile))
        self.subscribe_tiles(_EDGES, lambda tile: self.on_tile(_EDGES, tile))

    def on_units(self, message: Vector3Stamped) -> None:
        """Learn the source's units, and go on with the tiles that came before."""
        self._units = message
        for stamp in list(self._waiting):
            self._go_on_with(stamp)

    def on_origin(self, message: PointStamped) -> None:
        """Learn where the map lies, and go on with the tiles that came before."""
        self._origin = message
        for stamp in list(self._waiting):
            self._go_on_with(stamp)

    def on_tile(self, topic: str, tile: PointTile) -> None:
        """Take one tile's points, and trace its buildings when all is there."""
        parts = self._join.add(tile.stamp, topic, tile)
        if parts is None:
            return
        if self._has_footprints and self._frame is None:
            self._waiting[tile.stamp] = parts
            return
        self._trace(tile.stamp, parts)

    @property
    def _frame(self) -> MapFrame | None:
        """Where the map lies, None as long as it is not known."""
        if self._origin is None or (self._units is None and self.count_publishers("map_units")):
            return None
        return frame_of(self._origin, self._units)

    def _go_on_with(self, stamp: int) -> None:
        """Trace a tile that has waited, if nothing is missing any more."""
        if stamp in self._waiting and self._frame is not None:
            with self.reporting(stamp) as report:
                parts = self._waiting.pop(stamp)
                report.n_points = len(parts[_EDGES])
                self._trace(stamp, parts)

    def _trace(self, stamp: int, parts: Parts) -> None:
        """Publish one tile's buildings, or ask for more of the tile."""
        traced = self._traced_tile(parts)
        if traced.clipped and self._clipped.get_subscription_count():
            self._clipped.publish(header_of(stamp))
            return
        self._building_points.publish(to_message(traced.tile))
        self.publish_rings(self._traced, outline_messages(stamp, traced.outlines))

    def _traced_tile(self, parts: Parts) -> TracedTile:
        """Trace one tile's buildings, or take the footprints for them."""
        config = self.parameters[FootprintNodeConfig]
        frame = self._frame
        if not self._has_footprints or frame is None:
            return trace_buildings(
                parts[_EDGES], self.parameters[SegmentationConfig], self.parameters[BoundaryTracingConfig]
            )
        given = read_footprints(FootprintSource(Path(config.file), config.layer), frame)
        return trace_footprints(
            parts[_ALL], parts[_EDGES], given.footprints, config, self.parameters[EdgeLabellingConfig]
        )


def _are_of_one_sending(parts: Parts) -> bool:
    """Whether a tile's clouds fit together: one that was sent larger has more points under the same stamp."""
    return _ALL not in parts or agree_on_roofs(parts[_ALL], parts[_EDGES])


def main() -> int:
    """Run the node."""
    return run_node(BuildingTracer)


if __name__ == "__main__":
    raise SystemExit(main())
