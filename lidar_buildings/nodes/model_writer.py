"""Node `model_writer`."""

from __future__ import annotations

import json
import re
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from functools import partial
from importlib import import_module
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import Header, String
from std_srvs.srv import Trigger

from lidar_buildings.core.model.errors import ExitStatus, LidarBuildingsError, OutputError
from lidar_buildings.core.model.ids import tile_of
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.replicas import ReplicaConfig
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.io.clouds.find_inputs import InputFile
from lidar_buildings.io.models.cityjson import checked_feature
from lidar_buildings.io.results.run_record import RunRecord
from lidar_buildings.io.results.run_summary import RunSummary, counted
from lidar_buildings.io.results.survey_folder import SurveyFolder
from lidar_buildings.io.results.tile_products import TileProducts
from lidar_buildings.nodes.configs import NODE_CONFIGS, ModelWriterConfig
from lidar_buildings.nodes.map_frames import FrameListener
from lidar_buildings.nodes.table import NODE_STAGES, nodes_until, writer_topics
from lidar_buildings.pipeline.tile_stages import rasterise_tile
from lidar_buildings.ros.polygons import outlines_of
from lidar_buildings.ros.qos import BUILDING, CLOUD, EVENT, LATCHED, LATCHED_HISTORY
from lidar_buildings.ros.stage_node import StageNode, reason_of
from lidar_buildings.ros.stamps import header_of, to_stamp
from lidar_buildings.ros.text_messages import closed_tile, facades_of, is_model, is_provisional
from lidar_buildings.ros.tile_table import Parts, agree_on_buildings

#: So long diagnostics of the last tiles are waited for, which are sent right after the results; and how often
#: it is looked whether all have come [s].
_PATIENCE, _TICK = 0.5, 0.05
#: How many models wait for their tile; wide margin: a tile has hundreds. The oldest are of tiles sent again.
_MAX_FEATURES = 100_000
_MODELS, _OUTLINES, _TRACED = "city_model", "outlines", "traced_outlines"
_FACADES = "facade_records"


class ModelWriter(StageNode):
    """
    Puts tiles on disk as they are complete, and makes the files when the survey is done.

    `is_over` once the source has said that it is. `last_words` say what was made last, `finished_from` when
    the last files after `survey_done` were begun [s], `n_clouds_left` how many clouds are left to write.
    """

    def __init__(self, *, read: Sequence[InputFile] = (), **kwargs: Any) -> None:
        super().__init__("model_writer", NODE_CONFIGS["model_writer"], **kwargs)
        self.n_clouds_left, self.finished_from = 0, 0.0
        self.last_words = ""
        config = self.parameters[ModelWriterConfig]
        with self.starting():
            self._survey = SurveyFolder(config, read)
        self._stages = [NODE_STAGES[name] for name in nodes_until(config.until)[1:-1]]
        self._topics = writer_topics(config.until)
        told = self._survey.settings
        self._record = RunRecord({name: told[name] for name in ("bags", "preset") if told.get(name)})
        self._features: OrderedDict[int, str] = OrderedDict()  # building → its model, as a line of text
        self._waited = 0.0  # for diagnostics since the survey was done [s]
        self._has_loaded = self._has_news = False
        self._begin()
        self.summary.gauges.append(
            lambda: {"tiles_on_disk": len(self._survey.on_disk), "clouds_left": self.n_clouds_left}
        )
        self._map: FrameListener | None = None
        if self._survey.frame is None:
            self._map = FrameListener(self, self.on_frame, config.frame_patience)
        self.create_subscription(
            DiagnosticArray, "diagnostics", partial(note_diagnostics, self._record), EVENT
        )
        self.create_subscription(Header, "tile_failed", self.on_failed, LATCHED_HISTORY)
        self.create_subscription(Header, "survey_done", self.on_survey_done, LATCHED)
        self.take_tiles(self._topics, self.work, self.publish, self._fits)
        for topic in self._topics:
            if topic == _MODELS:
                self.create_subscription(String, topic, self.on_feature, BUILDING)
            elif topic == _FACADES:
                self.create_subscription(String, topic, self.on_facades, CLOUD)
            elif topic in (_TRACED, _OUTLINES):
                self.subscribe_rings(topic, outlines_of)
            else:
                self.subscribe_tiles(topic)
        self.create_service(Trigger, "~/save", self.on_save)
        self.create_service(Trigger, "~/reset", self.on_reset)
        self._end_timer = self.create_timer(_TICK, self._finish_if_told)
        self._end_timer.cancel()

    @property
    def failed_tiles(self) -> dict[int, str]:
        """Tiles that were given up → why."""
        failed = [one for one in self._record.failed if one > self._survey.revision_of(one)]
        return self._record.reasons(map(tile_of, failed))

    # tiles

    def is_ready(self) -> str:
        """Tiles are put on disk in coordinates of the map."""
        if self._map is not None:
            self._map.expect()
        return "map_origin" if self._survey.frame is None else ""

    def drops(self, stamp: int, topic: str) -> bool:
        """A tile that is on disk in this or a later revision is reported: its source lacked that answer."""
        if stamp > self._survey.revision_of(stamp):
            return super().drops(stamp, topic)
        if topic == self._topics[0]:
            self._report_done(stamp)
        return True

    def work(self, *parts: Any) -> Future[TileProducts]:
        """Put one tile on disk."""
        of_tile = dict(zip(self._topics, parts, strict=True))
        features = tuple(self._features.pop(number) for number in sorted(self._modelled(of_tile)))
        return self.submit_here(self._write, of_tile, features)

    def publish(self, stamp: int, products: TileProducts) -> None:
        """Report one tile as done."""
        self._written.add(tile_of(stamp))
        self._has_news = True
        self.summary.passed_on(len(products.core))
        self.summary.counts["buildings"] += products.n_buildings
        self._report_done(stamp)
        if not self._has_loaded:  # what files need, in a time when nothing else is to be done
            self._has_loaded = True
            self.submit_here(import_module, "lidar_buildings.report.page_file")
            self.submit_here(self._survey.folder.load_writers)

    def _write(self, parts: Parts, features: tuple[str, ...]) -> TileProducts:
        """Write the fragment of a tile; in the node's thread."""
        clouds = [one for one in parts.values() if isinstance(one, PointTile)]
        rasterise = partial(rasterise_tile, clouds[0], self.parameters[ModelWriterConfig], self._survey.frame)
        results = {
            "traced": parts.get(_TRACED, ()),
            "outlines": parts.get(_OUTLINES, ()),
            "features": features,
            "facades": parts.get(_FACADES, ()),
            "rasters": rasterise() if self.pool is None else self.pool.submit(rasterise).result(),
        }
        try:
            return self._survey.write_tile(clouds, **results)
        except OutputError as error:
            failure = error
            self.call_soon(lambda: self.fail(failure))
            raise

    def on_feature(self, message: String) -> None:
        """Take a building's model; InputError if a feature is not one of a building."""
        line = message.data
        if (stamp := closed_tile(line)) is not None:
            self.add_part(stamp, _MODELS, True)
        elif is_model(line) and not is_provisional(line):
            number = checked_feature(line)
            self._features[number] = line
            self._features.move_to_end(number)
            while len(self._features) > _MAX_FEATURES:
                self._features.popitem(last=False)

    def on_facades(self, message: String) -> None:
        """Take a tile's façades."""
        stamp, facades = facades_of(message)
        self.add_part(stamp, _FACADES, facades)

    def _fits(self, parts: Parts) -> bool:
        return agree_on_buildings(parts) and self._modelled(parts) <= self._features.keys()

    def _modelled(self, parts: Parts) -> set[int]:
        """Return the buildings of a tile that have models."""
        return {one.building_id for one in parts[_OUTLINES]} if _MODELS in self._topics else set()

    # the survey

    def on_frame(self, frame: MapFrame) -> None:
        """Take up a survey where it was left, and store the tiles that came before its frame."""
        before = self._survey.frame
        try:
            is_taken = self._survey.open(frame)
        except LidarBuildingsError as error:
            self.fail(error)
            return
        if not is_taken:
            self.warn("map_origin has changed: files keep the frame of the tiles on disk until ~/reset")
        if before is None:
            self._report_tiles_on_disk()
            self.look_again()

    def on_failed(self, message: Header) -> None:
        """Note that a tile was given up."""
        self._record.failed.add(to_stamp(message.stamp))

    def on_survey_done(self, _: Header) -> None:
        """Make the files as soon as it is known where they lie and what the nodes say of the last tiles."""
        self.is_over, self._waited = True, 0.0
        self._end_timer.reset()

    def on_save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Make the files of a live survey now."""
        if not self._survey.is_live:
            response.message = "only live surveys can be saved on request"
            return response
        error = self.submit_here(self._make_files).exception()
        response.success = error is None
        response.message = self.last_words if error is None else reason_of(error)
        return response

    def on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Forget the tiles of a live survey, whose source has begun anew; files made of them stay."""
        if not self._survey.is_live:
            response.message = "only live surveys can be reset: give model_writer.overwrite"
            return response
        n_tiles = len(self._survey.on_disk)
        if self._survey.folder is not None:
            self.submit_here(self._survey.folder.keep_only, ()).result()
        self._record.failed.clear()
        # with it goes what late listeners would hear of the tiles that were done
        self.destroy_publisher(self._tile_done)
        self._begin()
        if self._map is not None and self._map.frame is not None:
            self.on_frame(self._map.frame)
        response.success, response.message = True, f"forgotten: {counted(n_tiles, 'tile')}"
        return response

    def interrupted(self, spin_once: Callable[[float], None]) -> None:
        """Make the files of a live survey: nodes upstream may have ended, its tiles are on disk."""
        if not (self._survey.is_live and self._has_news and self._survey.on_disk):
            return
        work = self.submit_here(self._make_files)
        while not work.done():
            spin_once(_TICK)
        if (error := work.exception()) is not None:
            self.get_logger().error(f"no files were written: {reason_of(error)}")
        else:
            self.get_logger().info(self.last_words)

    def _begin(self) -> None:
        """Wait for tiles, and say which are on disk."""
        self.is_over = False
        self._written: set[int] = set()
        self._tile_done = self.create_publisher(Header, "tile_done", LATCHED_HISTORY)
        self._report_tiles_on_disk()

    def _report_done(self, stamp: int) -> None:
        """Say which revision of a tile is on disk."""
        self.n_reported = len(self._survey.on_disk)
        self._tile_done.publish(header_of(self._survey.revision_of(stamp)))

    def _report_tiles_on_disk(self) -> None:
        self.n_reported = 0
        for stamp in sorted(self._survey.on_disk):
            self._report_done(stamp)

    # files

    def _finish_if_told(self) -> None:
        """Make the files of a survey that is done once the diagnostics of the last tiles have come."""
        if self._survey.frame is None:
            return
        self._waited += _TICK
        if self._waited >= _PATIENCE or self._record.has_all(self._stages, self._written):
            self._end_timer.cancel()
            began = time.monotonic()
            self.when_done(self.submit_here(self._make_files), lambda work: self._finish(work, began))

    def _finish(self, work: Future[RunSummary], began: float) -> None:
        """End, unless more tiles may come."""
        if work.cancelled():
            return
        error = work.exception()
        if error is None:
            self.finished_from = began
            self.get_logger().info(self.last_words)
            if not self._survey.is_live:
                self.exit_status = ExitStatus.TILE_FAILED if self.failed_tiles else ExitStatus.DONE
                self.outcome.set_result(work.result())
        elif self._survey.is_live:
            self.warn(f"no files were written: {reason_of(error)}")
        else:
            self.fail(error)

    def _make_files(self) -> RunSummary:
        """Make the files; in the node's thread."""
        from lidar_buildings.report.page_file import write_report  # what it needs is needed last

        self._has_news = False
        try:
            failed = self.failed_tiles
            record = self._record.as_dict(failed)
            summary = self._survey.make_files(record, self._each_cloud, write_report)
        except Exception:
            self._has_news = True
            raise
        finally:
            self.n_clouds_left = 0
        n_buildings = sum(summary.buildings.values())
        why = f"; {summary.why_no_building}" if summary.why_no_building else ""
        if failed:
            last = [*failed.values()][-1]
            why = f"; {counted(len(failed), 'tile')} failed, see failed_tiles in run.json: {last}"
        path = self.parameters[ModelWriterConfig].output
        written = f"{counted(summary.n_tiles, 'tile')}, {counted(n_buildings, 'building')}"
        self.last_words = f"written to {path}: {written}{why}"
        return summary

    def _each_cloud(self, write: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[Any]:
        """Write clouds side by side, and count them; what is left when ROS is shut down is left."""
        self.n_clouds_left = len(jobs)
        for one in (map if self.pool is None else self.pool.map)(write, jobs):
            if not self.context.ok():
                raise OutputError(f"{self.n_clouds_left} classified clouds are left for the next time")
            self.n_clouds_left -= 1
            yield one


def note_diagnostics(record: RunRecord, message: DiagnosticArray) -> None:
    """
    Note what nodes report of tiles; their summaries say nothing here.

    ValueError if a number is none, or the parameters are not JSON of a node's.
    """
    for status in message.status:
        values = {pair.key: pair.value for pair in status.values}
        node = re.sub(r"_\d+$", "", status.name)  # of a replica, its kind
        if node not in NODE_CONFIGS or "tile" not in values:
            continue
        tile = tile_of(int(values["tile"]))
        if status.level == DiagnosticStatus.ERROR:
            record.errors[tile] = f"{status.name}: {status.message}"
            continue
        told = json.loads(values.get("parameters", "{}"))
        if not isinstance(told, dict) or not told.keys() <= NODE_CONFIGS[node].keys():
            raise ValueError(f"parameters of {node} are {values['parameters'][:100]}")
        record.parameters.update({name: of for name, of in told.items() if name != ReplicaConfig.stage})
        if node in NODE_STAGES and "seconds" in values:
            record.seconds[NODE_STAGES[node]][tile] = float(values["seconds"])
