"""The output folder of a survey, whose tiles come from files or live."""

from __future__ import annotations

import json
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lidar_buildings.core.model.errors import InputError, ParameterError
from lidar_buildings.core.model.ids import tile_of
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.io.bags.bag_inputs import bags_among, with_clouds
from lidar_buildings.io.clouds.agreement import in_frame
from lidar_buildings.io.clouds.find_inputs import InputFile
from lidar_buildings.io.clouds.las import frame_of, open_cloud, open_inputs
from lidar_buildings.io.results.output_config import OutputConfig, SurveyConfig
from lidar_buildings.io.results.output_folder import OutputFolder
from lidar_buildings.io.results.run_folder import Share, check_folder, sole_use
from lidar_buildings.io.results.run_summary import RunSummary
from lidar_buildings.io.results.tile_products import TileProducts

if TYPE_CHECKING:  # what reads them takes time to import
    from lidar_buildings.io.vectors.footprints import FootprintFile

#: Names of the files; number `source` by name has that source's points, row `index` by row.
PLACED_CLOUDS = "points_*.laz"


class SurveyFolder:
    """
    Takes a survey's tiles and makes its files, whether its inputs are known before or only at the end.

    Without inputs the survey is live: tiles go on coming after files were made. Such a survey, and one of
    bags, has a frame, and with it its `folder`, from `open` on. `settings` are what results depend on. The
    points of files that were `read` in this process may still be decoded. LidarBuildingsError if inputs
    cannot be read, or the folder cannot be used.
    """

    def __init__(self, config: SurveyConfig, read: Sequence[InputFile] = ()) -> None:
        if not config.output:
            raise ParameterError("model_writer.output is empty: name a folder for the results")
        self._config = config
        self.is_live = not config.input
        self._bags = bags_among(config.input)
        if self._bags and not config.placed:
            raise ParameterError("model_writer.placed is empty: bags need the folder of tile_player.placed")
        try:
            self.settings = dict(json.loads(config.settings or "{}"))
        except (ValueError, TypeError) as error:
            raise ParameterError(f"model_writer.settings is not a JSON object: {error}") from error
        self._read = {(one.path, one.state): one for one in read}
        self._problems: list[str] = []
        self.folder: OutputFolder | None = None
        held = ExitStack()
        weakref.finalize(self, held.close)
        held.enter_context(sole_use(Path(config.output)))
        if self.is_live or self._bags:
            check_folder(Path(config.output), overwrite=config.overwrite, is_live=self.is_live)
        else:
            self._claim(config.input)

    @property
    def frame(self) -> MapFrame | None:
        """The frame of the tiles on disk, None as long as a live survey has none."""
        return None if self.folder is None else self.folder.frame

    @property
    def on_disk(self) -> dict[int, int]:
        """See `OutputFolder`; empty as long as a live survey has no frame."""
        return {} if self.folder is None else self.folder.on_disk

    def revision_of(self, stamp: int) -> int:
        """Return the stamp of the revision of a tile that is on disk, -1 if none is."""
        return self.on_disk.get(tile_of(stamp), -1)

    def open(self, frame: MapFrame) -> bool:
        """
        Go on in a frame that a source has told of; return False if tiles on disk are of another one.

        A live source has no files yet then; of bags it has placed the scans. LidarBuildingsError if the
        folder holds tiles of another run.
        """
        if self.frame != frame and self.on_disk:
            return False
        if self.frame != frame:
            placed = with_clouds(self._config.input, Path(self._config.placed)) if self._bags else ()
            self._claim(placed, frame)
        return True

    def write_tile(self, clouds: Sequence[PointTile], **results: Any) -> TileProducts:
        """Put a tile on disk, of what `TileProducts.from_tiles` takes; OutputError if that fails."""
        if self.is_live and any(one.source is None or one.index is None for one in clouds):
            # points of somebody else, of which there are no files
            clouds = [one.select(np.zeros(0, dtype=np.intp)) for one in clouds]
        products = TileProducts.from_tiles(*clouds, **results)
        self.folder.write_tile(products)
        return products

    def make_files(
        self,
        run_info: Mapping[str, Any],
        share: Share = map,
        write_report: Callable[[Path, dict[str, Any]], Any] | None = None,
    ) -> RunSummary:
        """
        Make the files of the tiles on disk, those of a live survey with the clouds that are there now.

        `share` and `write_report` are those of `OutputFolder.finalise`. LidarBuildingsError if no frame is
        known, or a file cannot be written.
        """
        if self.folder is None:
            raise ParameterError("no tile has arrived yet: the map frame is unknown")
        problems, placed = list(self._problems), self._config.placed
        self.folder.inputs = [self._read.get((one.path, one.state), one) for one in self.folder.inputs]
        if self.is_live:
            self.folder.inputs = placed_inputs(Path(placed)) if placed else []
            if not self.folder.inputs:
                where = f"{placed}/{PLACED_CLOUDS}" if placed else "no folder named"
                problems.append(f"no classified clouds: the source's clouds are not on this host ({where})")
        info, has_failed = {**run_info, "problems": problems}, bool(run_info.get("failed_tiles"))
        return self.folder.finalise(info, share, has_failed=has_failed, write_report=write_report)

    def _claim(self, inputs: Sequence[str], frame: MapFrame | None = None) -> None:
        config = self._config
        clouds, self._problems = open_inputs(inputs) if inputs else ([], [])
        frame = frame or frame_of(clouds, config.crs)
        written = {one.name: getattr(config, one.name) for one in fields(OutputConfig)}
        self.folder = OutputFolder(
            config.output,
            [cloud.input_file for cloud in in_frame(clouds, frame)],
            frame,
            overwrite=config.overwrite and self.folder is None,
            until=config.until,
            parameters=self.settings | {OutputConfig.stage: written},
            footprints=_footprints(config, frame),
            files=config,
            is_live=self.is_live,
        )


def _footprints(config: SurveyConfig, frame: MapFrame) -> FootprintFile | None:
    if not config.footprints:
        return None
    from lidar_buildings.io.vectors.footprints import FootprintSource, read_footprints

    source = FootprintSource(Path(config.footprints), config.footprints_layer, config.footprint_id)
    return read_footprints(source, frame)


def placed_inputs(folder: Path) -> list[InputFile]:
    """Return a live source's clouds by name, none without its folder; unreadable ones have no points."""
    return [InputFile(path, _point_count(path)) for path in sorted(folder.glob(PLACED_CLOUDS))]


def _point_count(path: Path) -> int:
    try:
        return open_cloud(path).point_count
    except InputError:  # said when its points are to be read
        return 0
