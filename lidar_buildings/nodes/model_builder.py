"""Node `model_builder`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from std_msgs.msg import Header, String
from visualization_msgs.msg import MarkerArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.io.models.cityjson import feature_id, feature_line, header_line
from lidar_buildings.nodes.configs import FlowControlConfig, MapFrameConfig
from lidar_buildings.nodes.map_frames import FrameListener
from lidar_buildings.nodes.pool_node import PoolNode
from lidar_buildings.pipeline.tile_models import TileModel, build_models
from lidar_buildings.ros.features import tile_closing_message, withdrawal_message
from lidar_buildings.ros.markers import model_markers
from lidar_buildings.ros.outline_quality import qualities_of
from lidar_buildings.ros.polygons import Rings, roof_rings
from lidar_buildings.ros.qos import BUILDING, CLOUD, LATCHED, LATCHED_HISTORY
from lidar_buildings.ros.ring_collector import outlines_of
from lidar_buildings.ros.stamps import header_of
from lidar_buildings.ros.tile_join import Parts, TileJoin, agree_on_buildings
from lidar_buildings.ros.withdrawals import Withdrawals

_POINTS, _OUTLINES, _QUALITY = "plane_points", "outlines", "outline_quality"


class ModelBuilder(PoolNode):
    """Builds the models of each tile's buildings, and withdraws those that a tile has no more."""

    has_pool = True

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("model_builder", **kwargs)
        self._make_publishers()
        self._names: Withdrawals[str] = Withdrawals()
        self._numbers: Withdrawals[int] = Withdrawals()
        self._map = FrameListener(self, self.on_frame, self.parameters[MapFrameConfig].frame_patience)
        self._join = TileJoin(
            (_POINTS, _OUTLINES, _QUALITY), agree_on_buildings, lambda *_: self._map.expect()
        )
        self.subscribe_messages(String, _QUALITY, self.on_quality, CLOUD)
        self.subscribe_rings(_OUTLINES, self.on_outlines, is_part=True)
        self.subscribe_tiles(_POINTS, self.on_tile, is_part=True)

    def on_frame(self, frame: MapFrame) -> None:
        """Publish the header, and build the tiles that came before."""
        self._header.publish(String(data=header_line(frame)))
        for stamp, parts in self._join.take_ready():
            self._build(stamp, parts, frame)

    def on_quality(self, message: String) -> None:
        """Take the quality of one tile's outlines."""
        stamp, qualities = qualities_of(message)
        if self.takes(stamp):
            self._add(stamp, _QUALITY, qualities)

    def on_outlines(self, stamp: int, rings: Rings) -> None:
        """Take the outlines of one tile."""
        self._add(stamp, _OUTLINES, outlines_of(rings))

    def on_tile(self, tile: PointTile) -> None:
        """Take the points of one tile."""
        self._add(tile.stamp, _POINTS, tile)

    def _make_publishers(self) -> None:
        # one topic, two durabilities: each kind of subscription is meant to match its own publisher
        self._header = self.create_publisher(String, "city_model", LATCHED)
        self._features = self.create_message_outlet(String, "city_model", BUILDING)
        self._roof_faces = self.create_ring_outlet("roof_faces")
        self._markers = self.create_publisher(MarkerArray, "building_markers", CLOUD)
        self._tile_done = None
        if self.parameters[FlowControlConfig].publish_tile_done:
            self._tile_done = self.create_publisher(Header, "tile_done", LATCHED_HISTORY)

    def _add(self, stamp: int, topic: str, part: Any) -> None:
        parts, frame = self._join.add(stamp, topic, part), self._map.frame
        if parts is not None and frame is not None:
            self._build(stamp, parts, frame)

    def _build(self, stamp: int, parts: Parts, frame: MapFrame) -> None:
        with self.reporting(stamp) as report:
            report.n_points = len(parts[_POINTS])
            self._publish_models(stamp, parts, frame)

    def _publish_models(self, stamp: int, parts: Parts, frame: MapFrame) -> None:
        qualities = parts[_QUALITY]
        outlines = tuple(replace(one, quality=qualities.get(one.building_id)) for one in parts[_OUTLINES])
        models = build_models(parts[_POINTS], outlines, self.parameters[BuildingModelConfig], self._pool)
        self._features.publish(stamp, self._feature_messages(stamp, models, frame))
        faces = ((one.building_id, face) for one in models for face in one.model.roof_faces)
        self._roof_faces.publish(stamp, roof_rings(faces))
        self._publish_markers(stamp, models)
        self.summary.count_buildings(one.attributes["status"] for one in models)
        if self._tile_done is not None:
            self._tile_done.publish(header_of(stamp))

    def _feature_messages(self, stamp: int, models: Sequence[TileModel], frame: MapFrame) -> Iterator[String]:
        """Yield a tile's models, then the names of those that it has no more, then that this is all."""
        names = []
        for one in models:
            line = feature_line(one.model, one.building_id, frame, one.attributes, anchor=one.anchor)
            names.append(feature_id(one.anchor, frame))
            yield String(data=line)
        yield from map(withdrawal_message, self._names.of(stamp, names))
        yield tile_closing_message(stamp)

    def _publish_markers(self, stamp: int, models: Sequence[TileModel]) -> None:
        """Publish the solids' edges if anyone looks at them."""
        solids = {one.building_id: one.model.solids.values() for one in models}
        gone = self._numbers.of(stamp, solids)
        if (solids or gone) and self._markers.get_subscription_count():
            self._markers.publish(model_markers(stamp, solids, gone))
