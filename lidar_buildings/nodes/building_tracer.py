"""Node `building_tracer`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.boundary_tracing.config import BoundaryTracingConfig
from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.core.stages.segmentation.config import SegmentationConfig
from lidar_buildings.nodes.configs import FootprintNodeConfig, MapFrameConfig
from lidar_buildings.nodes.map_frames import FrameListener
from lidar_buildings.nodes.pool_node import PoolNode
from lidar_buildings.pipeline.tile_tracing import TracedTile, trace_footprints, trace_or_close
from lidar_buildings.ros.clipped_tiles import ClippedTiles
from lidar_buildings.ros.polygons import outline_rings
from lidar_buildings.ros.tile_join import Parts, TileJoin

_EDGES, _ALL = "edge_points", "classified_points"


class BuildingTracer(PoolNode):
    """Traces the buildings of each tile, or takes given footprints; holds a tile back that cuts one off."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("building_tracer", **kwargs)
        self._building_points = self.create_tile_outlet("building_points")
        self._traced = self.create_ring_outlet("traced_outlines")
        self._map: FrameListener | None = None
        if self.parameters[FootprintNodeConfig].file:
            self._map = FrameListener(
                self, lambda _: self._go_on(), self.parameters[MapFrameConfig].frame_patience
            )
        topics = (_EDGES,) if self._map is None else (_EDGES, _ALL)
        self._join = TileJoin(topics, is_ready=lambda *_: self._knows_frame())
        for topic in topics:
            self.subscribe_tiles(topic, lambda tile, topic=topic: self.on_tile(topic, tile), is_part=True)
        self._clipped = ClippedTiles(self)

    def on_tile(self, topic: str, tile: PointTile) -> None:
        """Take one tile's points, and trace its buildings when all is there."""
        parts = self._join.add(tile.stamp, topic, tile)
        if parts is not None:
            self._trace(tile.stamp, parts)

    def _knows_frame(self) -> bool:
        """Whether it is known where the map lies, if footprints are given."""
        return self._map is None or self._map.expect()

    def _go_on(self) -> None:
        """Trace the tiles that came before the map frame."""
        for stamp, parts in self._join.take_ready():
            self._trace(stamp, parts)

    def _trace(self, stamp: int, parts: Parts) -> None:
        with self.reporting(stamp) as report:
            report.n_points = len(parts[_EDGES])
            traced = self._traced_tile(parts)
            self._clipped.hand_on(stamp, traced.clipped, lambda: self._hand_on(stamp, traced))

    def _hand_on(self, stamp: int, traced: TracedTile) -> None:
        self._building_points.publish(stamp, traced.tile)
        self._traced.publish(stamp, outline_rings(traced.outlines))
        self.summary.counts["buildings"] += len(traced.outlines)

    def _traced_tile(self, parts: Parts) -> TracedTile:
        config = self.parameters[FootprintNodeConfig]
        frame = None if self._map is None else self._map.frame
        if frame is None:
            return trace_or_close(
                parts[_EDGES],
                self.parameters[SegmentationConfig],
                self.parameters[BoundaryTracingConfig],
                self._pool,
            )
        from lidar_buildings.io.vectors.footprints import FootprintSource, read_footprints  # loads slowly

        given = read_footprints(FootprintSource(Path(config.file), config.layer), frame)
        return trace_footprints(
            parts[_ALL], parts[_EDGES], given.footprints, config, self.parameters[EdgeLabellingConfig]
        )
