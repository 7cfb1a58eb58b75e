"""Node `model_writer`."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.timer import Timer
from std_msgs.msg import Header, String

from lidar_buildings.core.model.errors import OutputError, ParameterError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.terrain import TerrainRasters
from lidar_buildings.io.clouds.las import InputFile, frame_of, open_inputs
from lidar_buildings.io.models.cityjson import load_feature
from lidar_buildings.io.results.output_config import OutputConfig
from lidar_buildings.io.results.output_folder import OutputFolder
from lidar_buildings.io.results.tile_products import TileProducts
from lidar_buildings.io.vectors.footprints import FootprintFile, FootprintSource, read_footprints
from lidar_buildings.nodes.configs import NODE_CONFIGS, ModelWriterConfig
from lidar_buildings.nodes.run_record import RunRecord
from lidar_buildings.nodes.table import NODE_STAGES, nodes_until, writer_topics
from lidar_buildings.nodes.topics import CITY_MODEL, OUTLINES, ROOF_FACES, TRACED_OUTLINES
from lidar_buildings.pipeline.building_pool import BuildingPool
from lidar_buildings.pipeline.tile_rasters import rasterise_tile
from lidar_buildings.ros.features import FeaturePool
from lidar_buildings.ros.polygons import Rings
from lidar_buildings.ros.qos import BUILDING, EVENT, LATCHED, LATCHED_HISTORY
from lidar_buildings.ros.ring_collector import outlines_of
from lidar_buildings.ros.runner import run_node
from lidar_buildings.ros.stage_node import StageNode
from lidar_buildings.ros.stamps import header_of, tile_of, to_stamp
from lidar_buildings.ros.tile_join import Parts, TileJoin, agree_on_buildings

#: Exit status when a tile was given up and the rest was done.
TILE_FAILED = 3
#: After so long without diagnostics the last have come [s]; at most so many periods are waited for them.
#: Wide margin: they are sent right after the results.
_SILENCE, _MAX_PERIODS = 0.1, 20


@dataclass(eq=False)
class _AllPoints:
    """All points of a tile, and their rasters, which are made when first asked for."""

    tile: PointTile
    rasterise: Callable[[PointTile], TerrainRasters | None]

    def rasters(self) -> TerrainRasters | None:
        """Return the rasters, None where none are wanted."""
        return self._made

    @cached_property
    def _made(self) -> TerrainRasters | None:
        return self.rasterise(self.tile)


class ModelWriter(StageNode):
    """Puts tiles on disk as they are complete, and makes the files when the survey is done."""

    def __init__(self, pool: BuildingPool | None = None, **kwargs: Any) -> None:
        super().__init__("model_writer", NODE_CONFIGS["model_writer"], **kwargs)
        self._pool = pool or BuildingPool(0)
        try:
            self._open(self.parameters[ModelWriterConfig])
        except Exception:
            self.destroy_node()
            raise
        self._tile_done = self.create_publisher(Header, "tile_done", LATCHED_HISTORY)
        for stamp in sorted(self._on_disk):
            self._tile_done.publish(header_of(stamp))
        self.create_subscription(DiagnosticArray, "diagnostics", self._record.add, EVENT)
        self.create_subscription(Header, "tile_failed", self.on_failed, LATCHED_HISTORY)
        self.create_subscription(Header, "survey_done", self.on_survey_done, LATCHED)
        self._subscribe_results()

    @property
    def failed_tiles(self) -> dict[int, str]:
        """Tiles that were given up → why."""
        return self._record.reasons(self._record.failed - self._on_disk)

    def on_tile(self, topic: str, tile: PointTile) -> None:
        """Take points of one tile; a tile that is on disk already was sent again for want of this answer."""
        if tile_of(tile.stamp) not in self._on_disk:
            self._add(
                tile.stamp, topic, tile if topic != self._topics[0] else _AllPoints(tile, self._rasterised)
            )
        elif topic == self._topics[0]:
            self._tile_done.publish(header_of(tile.stamp))

    def on_rings(self, topic: str, stamp: int, rings: Rings) -> None:
        """
        Take outlines or roof faces of one tile.

        Outlines are traced of a tile that is large enough: its rasters are made while its models are built.
        """
        if topic == TRACED_OUTLINES.name:
            all_points = self._join.part(stamp, self._topics[0])
            if all_points is not None:
                all_points.rasters()
        if tile_of(stamp) not in self._on_disk:
            # the models have the faces; that they have come is all that is to know
            self._add(stamp, topic, None if topic == ROOF_FACES.name else outlines_of(rings))

    def on_feature(self, message: String) -> None:
        """Take one building's model; its tile is the one that waits for this building."""
        if not message.data.startswith('{"type":"CityJSONFeature"'):
            return
        try:
            _, number = load_feature(message.data)
        except Exception as error:
            self.get_logger().error(f"city_model: {error}: left out")
            return
        if self._features.add(number, message.data):
            for stamp, parts in self._join.take_ready():
                with self.reporting(stamp):
                    self._store(stamp, parts)

    def on_failed(self, message: Header) -> None:
        """Note that a tile was given up."""
        self._record.failed.add(tile_of(to_stamp(message.stamp)))

    def on_survey_done(self, _: Header) -> None:
        """Make the files as soon as the diagnostics of the last tiles have come, and end."""
        if self._end_timer is None and self._record.has_all(self._stages, self._written):
            self._finish()
        elif self._end_timer is None:
            self._counts = [self._record.n_heard]
            self._end_timer = self.create_timer(_SILENCE, self._finish_after_silence)

    def _finish_after_silence(self) -> None:
        """Make the files if no diagnostics have come since the last call."""
        self._counts.append(self._record.n_heard)
        if self._counts[-1] == self._counts[-2] or len(self._counts) > _MAX_PERIODS:
            self._end_timer.cancel()
            self._finish()

    def _finish(self) -> None:
        failed = self._record.failed - self._on_disk
        try:
            summary = self._folder.finalise(self._record.as_dict(failed, self._problems))
        except Exception as error:
            self.fail(error)
            return
        self.exit_status = TILE_FAILED if failed else 0
        self.get_logger().info(f"{summary.n_tiles} tiles are written to {self._folder.path}")
        self.outcome.set_result(summary)

    def _open(self, config: ModelWriterConfig) -> None:
        """Look at the inputs and claim the output folder."""
        if not config.output:
            raise ParameterError(f"{self.get_name()}.output is empty: name a folder for the results")
        clouds, self._problems = open_inputs(config.input)
        inputs = [InputFile(cloud.path, cloud.point_count) for cloud in clouds]
        self._folder = OutputFolder(
            config.output,
            inputs,
            frame_of(clouds),
            overwrite=config.overwrite,
            until=config.until,
            parameters=_settings(config.settings) | {OutputConfig.stage: _output_settings(config)},
            footprints=_footprints(config, frame_of(clouds)),
            formats=config.formats,
        )
        self._on_disk = self._folder.done_stamps()
        self._written: set[int] = set()
        self._stages = [NODE_STAGES[name] for name in nodes_until(config.until)[1:-1]]
        bags = _settings(config.settings).get("bags")
        self._record = RunRecord({"bags": bags} if bags else {})
        self._topics = [topic.name for topic in writer_topics(config.until)]
        self._end_timer: Timer | None = None
        self._features = FeaturePool()
        self._join = TileJoin(
            (t for t in self._topics if t != CITY_MODEL.name), agree_on_buildings, self._has_features
        )

    def _subscribe_results(self) -> None:
        """Subscribe to what the last stage of the run and those before it publish."""
        for topic in self._topics:
            if topic == CITY_MODEL.name:
                silent = SubscriptionEventCallbacks(use_default_callbacks=False)
                self.create_subscription(String, topic, self.on_feature, BUILDING, event_callbacks=silent)
            elif topic in (TRACED_OUTLINES.name, OUTLINES.name, ROOF_FACES.name):
                self.subscribe_rings(topic, lambda stamp, rings, t=topic: self.on_rings(t, stamp, rings))
            else:
                self.subscribe_tiles(topic, lambda tile, t=topic: self.on_tile(t, tile))

    def _add(self, stamp: int, topic: str, part: Any) -> None:
        parts = self._join.add(stamp, topic, part)
        if parts is not None:
            self._store(stamp, parts)

    def _has_features(self, stamp: int, parts: Parts) -> bool:
        """Whether the models of all buildings of a tile have come."""
        return not self._features.expect(stamp, self._buildings_of(parts))

    def _rasterised(self, tile: PointTile) -> TerrainRasters | None:
        return self._pool.call(rasterise_tile, tile, self.parameters[ModelWriterConfig], self._folder.frame)

    def _clouds_of(self, parts: Parts) -> list[PointTile]:
        """Return the clouds among a tile's parts: all its points first, then its roofs."""
        roofs = [parts[topic] for topic in self._topics if isinstance(parts.get(topic), PointTile)]
        return [parts[self._topics[0]].tile, *roofs]

    def _buildings_of(self, parts: Parts) -> set[int]:
        """Return the buildings whose models a tile must wait for."""
        if CITY_MODEL.name not in self._topics:
            return set()
        return {one.building_id for one in parts[OUTLINES.name]}

    def _store(self, stamp: int, parts: Parts) -> None:
        self._write(parts)
        self._tile_done.publish(header_of(stamp))
        self.summary.handed_on(stamp, len(self._clouds_of(parts)[0]))

    def _write(self, parts: Parts) -> None:
        classified, *roofs = self._clouds_of(parts)
        products = TileProducts.from_tiles(
            replace(classified, stamp=tile_of(classified.stamp)),
            *roofs,
            traced=parts.get(TRACED_OUTLINES.name, ()),
            outlines=parts.get(OUTLINES.name, ()),
            features=self._features.take(sorted(self._buildings_of(parts))),
            rasters=parts[self._topics[0]].rasters(),
        )
        try:
            self._folder.write_tile(products)
        except OutputError as error:
            self.fail(error)
            raise
        self._on_disk.add(products.stamp)
        self._written.add(products.stamp)


def _settings(text: str) -> dict[str, Any]:
    try:
        settings = json.loads(text or "{}")
    except ValueError as error:
        raise ParameterError(f"model_writer.settings is no JSON: {error}") from error
    if not isinstance(settings, dict):
        raise ParameterError("model_writer.settings must be a JSON object")
    return settings


def _footprints(config: ModelWriterConfig, frame: MapFrame) -> FootprintFile | None:
    if not config.footprints:
        return None
    source = FootprintSource(Path(config.footprints), config.footprints_layer, config.footprint_id)
    return read_footprints(source, frame)


def _output_settings(config: OutputConfig) -> dict[str, Any]:
    """Return the parameters of what is written, on which an unfinished run depends as well."""
    return {one.name: getattr(config, one.name) for one in fields(OutputConfig)}


def main() -> int:
    """Run the node."""
    return run_node(ModelWriter)


if __name__ == "__main__":
    raise SystemExit(main())
