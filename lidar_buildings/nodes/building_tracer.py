"""Node `building_tracer`."""

from __future__ import annotations

from concurrent.futures import Future
from pathlib import Path
from typing import Any

from geometry_msgs.msg import PolygonInstanceStamped
from sensor_msgs.msg import PointCloud2

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.boundary_tracing.config import BoundaryTracingConfig
from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.core.stages.segmentation.config import SegmentationConfig
from lidar_buildings.nodes.configs import NODE_CONFIGS, FootprintNodeConfig, MapFrameConfig
from lidar_buildings.nodes.map_frames import FrameListener
from lidar_buildings.pipeline.tile_tracing import TracedTile, trace_footprints, trace_or_close
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.polygons import outline_rings, ring_messages
from lidar_buildings.ros.qos import BUILDING, CLOUD
from lidar_buildings.ros.stage_node import StageNode, publish_all

_EDGES, _ALL = "edge_points", "classified_points"


class BuildingTracer(StageNode):
    """Traces the buildings of each tile, or takes given footprints; holds a tile back that cuts one off."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("building_tracer", NODE_CONFIGS["building_tracer"], **kwargs)
        self._building_points = self.create_output(PointCloud2, "building_points", CLOUD)
        self._traced = self.create_output(PolygonInstanceStamped, "traced_outlines", BUILDING)
        self._map: FrameListener | None = None
        topics, work = (_EDGES,), self.trace
        if self.parameters[FootprintNodeConfig].file:
            patience = self.parameters[MapFrameConfig].frame_patience
            self._map = FrameListener(self, lambda _: self.look_again(), patience)
            topics, work = (_EDGES, _ALL), self.take_footprints
        self.take_tiles(topics, work, self.publish, clipped=lambda traced: traced.clipped)
        for topic in topics:
            self.subscribe_tiles(topic)

    def is_ready(self) -> str:
        """Footprints are given in coordinates of the map."""
        return "" if self._map is None or self._map.expect() else "map_origin"

    def trace(self, roofs: PointTile) -> Future[TracedTile]:
        """Trace one tile's buildings."""
        segmentation = self.parameters[SegmentationConfig]
        return self.submit_shared(trace_or_close, roofs, segmentation, self.parameters[BoundaryTracingConfig])

    def take_footprints(self, roofs: PointTile, classified: PointTile) -> Future[TracedTile]:
        """Find the points of one tile's footprints."""
        frame = None if self._map is None else self._map.frame
        config, labelling = self.parameters[FootprintNodeConfig], self.parameters[EdgeLabellingConfig]
        return self.submit_here(_footprints, classified, roofs, config, labelling, frame)

    def publish(self, stamp: int, traced: TracedTile) -> None:
        """Publish one tile's buildings."""
        self.summary.passed_on(len(traced.tile))
        self._building_points.publish(to_message(traced.tile))
        publish_all(self._traced, ring_messages(stamp, outline_rings(traced.outlines)))
        self.summary.counts["buildings"] += len(traced.outlines)


def _footprints(
    classified: PointTile,
    roofs: PointTile,
    config: FootprintNodeConfig,
    labelling: EdgeLabellingConfig,
    frame: MapFrame,
) -> TracedTile:
    from lidar_buildings.io.vectors.footprints import FootprintSource, read_footprints  # loads slowly

    given = read_footprints(FootprintSource(Path(config.file), config.layer), frame)
    return trace_footprints(classified, roofs, given.footprints, config, labelling)
