"""Node `model_builder`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from geometry_msgs.msg import PointStamped, PolygonInstanceStamped, Vector3Stamped
from rclpy.event_handler import PublisherEventCallbacks
from std_msgs.msg import Header, String
from visualization_msgs.msg import MarkerArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.building_model import BuildingModelConfig
from lidar_buildings.core.stages.regularisation import RegularisationConfig
from lidar_buildings.io.models.cityjson import feature_line, header_line
from lidar_buildings.nodes.configs import NODE_CONFIGS, FlowControlConfig
from lidar_buildings.pipeline.tile_models import TileModel, build_models
from lidar_buildings.ros.map_frames import frame_of
from lidar_buildings.ros.markers import model_markers
from lidar_buildings.ros.polygons import roof_messages
from lidar_buildings.ros.publishing import publish_all
from lidar_buildings.ros.qos import BUILDING, CLOUD, LATCHED, LATCHED_HISTORY
from lidar_buildings.ros.ring_collector import Rings, outlines_of
from lidar_buildings.ros.runner import run_node
from lidar_buildings.ros.stage_node import StageNode
from lidar_buildings.ros.stamps import header_of
from lidar_buildings.ros.tile_join import TileJoin, agree_on_buildings

_POINTS, _TRACED, _OUTLINES = "plane_points", "traced_outlines", "outlines"


class ModelBuilder(StageNode):
    """Builds the models of each tile's buildings."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("model_builder", NODE_CONFIGS["model_builder"], **kwargs)
        self._join = TileJoin((_POINTS, _TRACED, _OUTLINES), agree_on_buildings)
        self._units: Vector3Stamped | None = None
        self._origin: PointStamped | None = None
        self._waiting: dict[int, dict[str, Any]] = {}
        self._make_publishers()
        self.create_subscription(Vector3Stamped, "map_units", self.on_units, LATCHED)
        self.create_subscription(PointStamped, "map_origin", self.on_origin, LATCHED)
        self.subscribe_rings(_TRACED, lambda stamp, rings: self.on_outlines(_TRACED, stamp, rings))
        self.subscribe_rings(_OUTLINES, lambda stamp, rings: self.on_outlines(_OUTLINES, stamp, rings))
        self.subscribe_tiles(_POINTS, self.on_tile)

    def on_units(self, message: Vector3Stamped) -> None:
        """Learn the source's units."""
        self._units = message
        self._on_frame()

    def on_origin(self, message: PointStamped) -> None:
        """Learn where the map lies."""
        self._origin = message
        self._on_frame()

    def on_outlines(self, topic: str, stamp: int, rings: Rings) -> None:
        """Take the outlines of one tile."""
        self._add(stamp, topic, outlines_of(rings))

    def on_tile(self, tile: PointTile) -> None:
        """Take the points of one tile."""
        self._add(tile.stamp, _POINTS, tile)

    def _make_publishers(self) -> None:
        """Create the publishers."""
        # One topic, two durabilities: each kind of subscription is meant to match its own publisher.
        silent = PublisherEventCallbacks(use_default_callbacks=False)
        self._header = self.create_publisher(String, "city_model", LATCHED)
        self._features = self.create_publisher(String, "city_model", BUILDING, event_callbacks=silent)
        self._roof_faces = self.create_publisher(PolygonInstanceStamped, "roof_faces", BUILDING)
        self._markers = self.create_publisher(MarkerArray, "building_markers", CLOUD)
        self._tile_done = None
        if self.parameters[FlowControlConfig].publish_tile_done:
            self._tile_done = self.create_publisher(Header, "tile_done", LATCHED_HISTORY)

    @property
    def _frame(self) -> MapFrame | None:
        """Where the map lies, None as long as it is not known."""
        if self._origin is None or (self._units is None and self.count_publishers("map_units")):
            return None
        return frame_of(self._origin, self._units)

    def _on_frame(self) -> None:
        """Publish the header and go on with the tiles that came before."""
        frame = self._frame
        if frame is None:
            return
        self._header.publish(String(data=header_line(frame)))
        waiting, self._waiting = self._waiting, {}
        for stamp, parts in waiting.items():
            with self.reporting(stamp):
                self._build(stamp, parts, frame)

    def _add(self, stamp: int, topic: str, part: Any) -> None:
        """Put a part to the others of its tile, and build when all are there."""
        parts = self._join.add(stamp, topic, part)
        if parts is None:
            return
        frame = self._frame
        if frame is None:
            self._waiting[stamp] = parts
            return
        self._build(stamp, parts, frame)

    def _build(self, stamp: int, parts: dict[str, Any], frame: MapFrame) -> None:
        """Build one tile's models and publish them."""
        models = build_models(
            parts[_POINTS],
            parts[_TRACED],
            parts[_OUTLINES],
            self.parameters[BuildingModelConfig],
            self.parameters[RegularisationConfig],
        )
        publish_all(self._features, (String(data=_feature(one, frame)) for one in models))
        faces = ((one.building_id, face) for one in models for face in one.model.roof_faces)
        self.publish_rings(self._roof_faces, roof_messages(stamp, faces))
        self._publish_markers(stamp, models)
        if self._tile_done is not None:
            self._tile_done.publish(header_of(stamp))

    def _publish_markers(self, stamp: int, models: Sequence[TileModel]) -> None:
        """Publish the solids' edges if anyone looks at them."""
        solids = [solid for one in models for solid in one.model.solids.values()]
        if solids and self._markers.get_subscription_count():
            self._markers.publish(model_markers(stamp, solids))


def _feature(one: TileModel, frame: MapFrame) -> str:
    """Return one building's line of CityJSON."""
    return feature_line(one.model, one.building_id, frame, one.attributes, anchor=one.anchor)


def main() -> int:
    """Run the node."""
    return run_node(ModelBuilder)


if __name__ == "__main__":
    raise SystemExit(main())
