"""Node `model_writer`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.timer import Timer
from std_msgs.msg import Header, String
from std_srvs.srv import Trigger

from lidar_buildings.core.model.errors import LidarBuildingsError, OutputError
from lidar_buildings.core.model.exit_status import ExitStatus
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.terrain.rasters import TerrainRasters
from lidar_buildings.io.clouds.find_inputs import InputFile
from lidar_buildings.io.results.run_summary import RunSummary
from lidar_buildings.nodes.configs import ModelWriterConfig
from lidar_buildings.nodes.map_frames import FrameListener
from lidar_buildings.nodes.pool_node import PoolNode
from lidar_buildings.nodes.run_record import RunRecord
from lidar_buildings.nodes.survey_folder import SurveyFolder
from lidar_buildings.nodes.table import NODE_STAGES, nodes_until, writer_topics
from lidar_buildings.nodes.tile_gathering import TileGathering
from lidar_buildings.nodes.topics import CITY_MODEL, OUTLINES, ROOF_FACES, TRACED_OUTLINES
from lidar_buildings.pipeline.tile_rasters import rasterise_tile
from lidar_buildings.ros.letterbox import Letterbox
from lidar_buildings.ros.polygons import Rings
from lidar_buildings.ros.qos import BUILDING, EVENT, LATCHED, LATCHED_HISTORY
from lidar_buildings.ros.receipts import DONE, TAKEN
from lidar_buildings.ros.stamps import header_of, tile_of, to_stamp
from lidar_buildings.ros.tile_join import Parts

#: After so long without diagnostics the last have come [s]; at most so many periods are waited for them.
#: Wide margin: they are sent right after the results.
_SILENCE, _MAX_PERIODS = 0.1, 20
#: Period of looks at diagnostics [s]; the middleware keeps those of a minute and more.
_LOOK = 5.0


class ModelWriter(PoolNode):
    """
    Puts tiles on disk as they are complete, and makes the files when the survey is done.

    `is_over` once the source has said that it is. `n_saved` and `last_words` say how often files were made,
    and what was made last; `n_clouds_left` how many classified clouds have still to be written.
    """

    def __init__(self, *, read: Sequence[InputFile] = (), **kwargs: Any) -> None:
        super().__init__("model_writer", **kwargs)
        self.n_saved, self.last_words = 0, ""
        self.n_clouds_left = 0
        config = self.parameters[ModelWriterConfig]
        with self.starting():
            self._survey = SurveyFolder(config, read)
        self._stages = [NODE_STAGES[name] for name in nodes_until(config.until)[1:-1]]
        self._topics = [topic.name for topic in writer_topics(config.until)]
        told = self._survey.settings
        self._record = RunRecord({name: told[name] for name in ("bags", "preset") if told.get(name)})
        self._end_timer: Timer | None = None
        self._begin()
        self.summary.watch(self._gauges)
        self._map: FrameListener | None = None
        if self._survey.frame is None:
            self._map = FrameListener(self, self.on_frame, config.frame_patience)
        self._statuses = Letterbox(self, DiagnosticArray, "diagnostics", self._record.add, EVENT)
        self.create_timer(_LOOK, self._statuses.look)
        self.create_subscription(Header, "tile_failed", self.on_failed, LATCHED_HISTORY)
        self.create_subscription(Header, "survey_done", self.on_survey_done, LATCHED)
        self._subscribe_results()
        self.create_service(Trigger, "~/save", self.on_save)
        self.create_service(Trigger, "~/reset", self.on_reset)

    @property
    def failed_tiles(self) -> dict[int, str]:
        """Tiles that were given up → why."""
        failed = self._record.failed
        return self._record.reasons(
            tile_of(stamp) for stamp in failed if stamp > self._survey.revision_of(stamp)
        )

    def on_frame(self, frame: MapFrame) -> None:
        """Take up a survey where it was left, and store the tiles that came before its frame."""
        before = self._survey.frame
        try:
            is_taken = self._survey.open(frame)
        except LidarBuildingsError as error:
            self.fail(error)
            return
        if not is_taken:
            self.warn("map_origin has changed: files stay in the frame of the tiles on disk until ~/reset")
        if before is None:
            self._report_tiles_on_disk()
            self._store_all(self._tiles.take_ready())
            if self.is_over:
                self._make_files_soon()

    def on_tile(self, topic: str, tile: PointTile) -> None:
        """Take points of one tile; if it is on disk in this or a later revision, it lacked that answer."""
        if self._map is not None:
            self._map.expect()
        elif not self._written:
            self._survey.load_writers()  # the tile has still to go through stages
        if tile.stamp > self._survey.revision_of(tile.stamp):
            self._store(tile.stamp, self._tiles.add_points(topic, tile))
        elif topic == self._topics[0]:
            self._report_done(tile.stamp)

    def on_rings(self, topic: str, stamp: int, rings: Rings) -> None:
        """Take outlines or roof faces of one tile."""
        if stamp > self._survey.revision_of(stamp):
            self._store(stamp, self._tiles.add_rings(topic, stamp, rings))

    def on_feature(self, message: String) -> None:
        """Take one building's model, or hear that a tile has no more of them."""
        self._store_all(self._tiles.add_feature(message.data))

    def on_failed(self, message: Header) -> None:
        """Note that a tile was given up."""
        self._record.failed.add(to_stamp(message.stamp))

    def on_survey_done(self, _: Header) -> None:
        """Make the files as soon as it is known where they lie and what the nodes say of the last tiles."""
        self.is_over = True
        if self._survey.frame is not None:
            self._make_files_soon()

    def on_save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Make the files of a live survey now."""
        if not self._survey.is_live:
            response.message = "files are made when the survey is done: it is none that has no end"
            return response
        try:
            summary = self._make_files()
        except Exception as error:
            response.message = " ".join(str(error).split())
            return response
        response.success, response.message = True, self._words(summary)
        return response

    def on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Forget the tiles of a live survey, whose source has begun anew."""
        if not self._survey.is_live:
            response.message = "only a live survey can begin anew: give model_writer.overwrite"
            return response
        n_tiles = len(self._survey.on_disk)
        self._survey.forget_tiles()
        self._record.failed.clear()
        # with it goes what late listeners would hear of the tiles that were done
        self.destroy_publisher(self._tile_done)
        self._begin()
        if self._map is not None and self._map.frame is not None:
            self.on_frame(self._map.frame)
        response.success, response.message = True, f"{n_tiles} tiles are forgotten"
        return response

    def _gauges(self) -> dict[str, int]:
        return {"tiles_on_disk": len(self._survey.on_disk), "clouds_left": self.n_clouds_left}

    def _begin(self) -> None:
        """Wait for tiles, and say which are on disk."""
        self.is_over = False
        self._written: set[int] = set()
        self._tiles = TileGathering(self._topics, self._rasterised, lambda: self._survey.frame is not None)
        self._tile_done = self.create_publisher(Header, "tile_done", LATCHED_HISTORY)
        self._report_tiles_on_disk()

    def _subscribe_results(self) -> None:
        """Subscribe to what the last stage of the run and those before it publish."""
        for topic in self._topics:
            if topic == CITY_MODEL.name:
                self.subscribe_messages(String, topic, self.on_feature, BUILDING)
            elif topic in (TRACED_OUTLINES.name, OUTLINES.name, ROOF_FACES.name):
                makes_rasters = topic == TRACED_OUTLINES.name
                self.subscribe_rings(topic, partial(self.on_rings, topic), is_part=not makes_rasters)
            else:
                self.subscribe_tiles(topic, partial(self.on_tile, topic), is_part=True)

    def _store_all(self, ready: Iterable[tuple[int, Parts]]) -> None:
        for stamp, parts in ready:
            self._store(stamp, parts)

    def _rasterised(self, tile: PointTile) -> TerrainRasters | None:
        return self._pool.call(rasterise_tile, tile, self.parameters[ModelWriterConfig], self._survey.frame)

    def _store(self, stamp: int, parts: Parts | None) -> None:
        """Put a tile on disk if it is complete."""
        if parts is not None:
            with self.reporting(stamp) as report:
                report.n_points = len(parts[self._topics[0]].tile)
                self._put_on_disk(stamp, parts)

    def _put_on_disk(self, stamp: int, parts: Parts) -> None:
        if stamp > self._survey.revision_of(stamp):
            products = self._tiles.products(parts, has_names=not self._survey.is_live)
            try:
                self._survey.write(products)
            except OutputError as error:
                self.fail(error)
                raise
            self._written.add(tile_of(stamp))
            self.summary.handed_on(stamp, len(products.core))
            self.summary.counts["buildings"] += products.n_buildings
        self._report_done(stamp)

    def _report_done(self, stamp: int) -> None:
        """Say which revision of a tile is on disk."""
        self._tile_done.publish(header_of(self._survey.revision_of(stamp)))

    def _report_tiles_on_disk(self) -> None:
        for stamp in sorted(self._survey.on_disk):
            self._report_done(stamp)

    def _make_files_soon(self) -> None:
        """Make the files once the diagnostics of the last tiles have come."""
        self._statuses.look()
        if self._end_timer is None and self._record.has_all(self._stages, self._written):
            self._finish()
        elif self._end_timer is None:
            self._counts = [self._record.n_heard]
            self._end_timer = self.create_timer(_SILENCE, self._finish_after_silence)

    def _finish_after_silence(self) -> None:
        """Make the files if no diagnostics have come since the last call."""
        self._statuses.look()
        self._counts.append(self._record.n_heard)
        if self._counts[-1] == self._counts[-2] or len(self._counts) > _MAX_PERIODS:
            self._end_timer.cancel()
            self._finish()

    def _finish(self) -> None:
        """Make the files, and end unless more tiles may come."""
        try:
            summary = self._make_files()
        except Exception as error:
            if not self._survey.is_live:
                self.fail(error)
                return
            self.warn(f"no files were made: {' '.join(str(error).split())}")
        else:
            self.get_logger().info(self._words(summary))
            if not self._survey.is_live:
                self.exit_status = ExitStatus.TILE_FAILED if self.failed_tiles else 0
                self.outcome.set_result(summary)
        if self._survey.is_live:
            self._end_timer = None

    def _make_files(self) -> RunSummary:
        """Make the files; the writer is at work, so that no tile that waits for it is sent again."""
        self._receipts.send(TAKEN)
        self._statuses.look()
        try:
            record = self._record.as_dict(self.failed_tiles)
            summary = self._survey.make_files(record, self._each_cloud, self._pool.map)
        finally:
            self.n_clouds_left = 0
            if self.context.ok():
                self._receipts.send(DONE)
        self.last_words, self.n_saved = self._words(summary), self.n_saved + 1
        return summary

    def _each_cloud(self, write: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[Any]:
        """Write clouds side by side, and count them; what is left when ROS is shut down is left."""
        self.n_clouds_left = len(jobs)
        for one in self._pool.map(write, jobs):
            if not self.context.ok():
                raise OutputError(f"{self.n_clouds_left} classified clouds are left for the next time")
            self.n_clouds_left -= 1
            yield one

    def _words(self, summary: RunSummary) -> str:
        n_buildings = sum(summary.buildings.values())
        why = f"; {summary.why_no_building}" if summary.why_no_building else ""
        return f"{summary.n_tiles} tiles, {n_buildings} buildings are written to {self._survey.path}{why}"
