"""Node `model_builder`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from dataclasses import replace
from itertools import chain
from typing import Any

from geometry_msgs.msg import PolygonInstanceStamped
from std_msgs.msg import Header, String
from visualization_msgs.msg import MarkerArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.outline import BuildingOutline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.io.models.cityjson import feature_id, feature_line, header_line
from lidar_buildings.nodes.configs import NODE_CONFIGS, FlowControlConfig, MapFrameConfig
from lidar_buildings.nodes.map_frames import FrameListener
from lidar_buildings.pipeline.tile_models import TileModel, build_models
from lidar_buildings.ros.markers import model_markers
from lidar_buildings.ros.polygons import outlines_of, ring_messages
from lidar_buildings.ros.qos import BUILDING, CLOUD, LATCHED, LATCHED_HISTORY, MAP, MAP_RINGS
from lidar_buildings.ros.stage_node import StageNode, publish_all
from lidar_buildings.ros.stamps import header_of
from lidar_buildings.ros.text_messages import (
    Qualities,
    qualities_of,
    tile_closing_message,
    withdrawal_message,
)
from lidar_buildings.ros.tile_intake import agree_on_buildings
from lidar_buildings.ros.withdrawals import Withdrawals

_POINTS, _OUTLINES, _QUALITY = "plane_points", "outlines", "outline_quality"


class ModelBuilder(StageNode):
    """Builds the models of each tile's buildings, and withdraws those that a tile has no more."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("model_builder", NODE_CONFIGS["model_builder"], **kwargs)
        # one topic, two durabilities: each kind of subscription is meant to match its own publisher
        self._header = self.create_publisher(String, "city_model", LATCHED)
        self._features = self.create_output(String, "city_model", BUILDING)
        self._roof_faces = self.create_publisher(PolygonInstanceStamped, "roof_faces", MAP_RINGS)
        self._markers = self.create_publisher(MarkerArray, "building_markers", MAP)
        self._tile_done = None
        if self.parameters[FlowControlConfig].publish_tile_done:
            self._tile_done = self.create_publisher(Header, "tile_done", LATCHED_HISTORY)
        self._frame = MapFrame()
        self._names: Withdrawals[str] = Withdrawals()
        self._numbers: Withdrawals[int] = Withdrawals()
        self._map = FrameListener(self, self.on_frame, self.parameters[MapFrameConfig].frame_patience)
        self.take_tiles((_POINTS, _OUTLINES, _QUALITY), self.work, self.publish, agree_on_buildings)
        self.subscribe_texts(_QUALITY, CLOUD, qualities_of)
        self.subscribe_rings(_OUTLINES, outlines_of)
        self.subscribe_tiles(_POINTS)

    def is_ready(self) -> str:
        """Models are written in coordinates of the map."""
        return "" if self._map.expect() else "map_origin"

    def on_frame(self, frame: MapFrame) -> None:
        """Publish the header, and build the tiles that came before."""
        self._frame = frame
        self._header.publish(String(data=header_line(frame)))
        self.look_again()

    def work(
        self, points: PointTile, outlines: tuple[BuildingOutline, ...], qualities: Qualities
    ) -> Future[tuple[TileModel, ...]]:
        """Build one tile's models."""
        outlines = tuple(replace(one, quality=qualities.get(one.building_id)) for one in outlines)
        return self.submit_shared(build_models, points, outlines, self.parameters[BuildingModelConfig])

    def publish(self, stamp: int, models: Sequence[TileModel]) -> None:
        """Publish one tile's models."""
        publish_all(self._features, self._feature_messages(stamp, models))
        faces = {one.building_id: tuple(chain.from_iterable(one.model.roof_faces)) for one in models}
        rings = {number: of_building for number, of_building in faces.items() if of_building}
        publish_all(self._roof_faces, ring_messages(stamp, rings))
        solids = {one.building_id: one.model.solids.values() for one in models}
        shown = model_markers(stamp, solids, self._numbers.of(stamp, solids))
        if shown.markers:  # late viewers get the last messages
            self._markers.publish(shown)
        self.summary.passed_on(0)
        self.summary.count_buildings(one.attributes["status"] for one in models)
        if self._tile_done is not None:
            self._tile_done.publish(header_of(stamp))
            self.state.n_done += 1

    def _feature_messages(self, stamp: int, models: Sequence[TileModel]) -> Iterator[String]:
        """Yield a tile's models, then the names of those that it has no more, then that this is all."""
        names, frame = [], self._frame
        for one in models:
            line = feature_line(one.model, one.building_id, frame, one.attributes, anchor=one.anchor)
            names.append(feature_id(one.anchor, frame))
            yield String(data=line)
        yield from map(withdrawal_message, self._names.of(stamp, names))
        yield tile_closing_message(stamp)
