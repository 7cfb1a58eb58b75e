"""A run without ROS: tiles through the pipeline in several processes, into the same files as the graph."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import asdict
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

import numpy as np

from lidar_buildings.commands.progress import RunOutcome, TilesDone, progress_bar
from lidar_buildings.commands.run_request import RunRequest
from lidar_buildings.commands.tile_work import (
    EarlierBuilding,
    TileOutcome,
    TileWork,
    do_tile,
    earlier_buildings,
)
from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.io.clouds.find_inputs import search_inputs
from lidar_buildings.io.results.output_folder import OutputFolder
from lidar_buildings.io.results.run_folder import (
    Use,
    folder_of_points,
    inputs_of_run,
    note_survey,
    recall_survey,
)
from lidar_buildings.io.results.run_summary import counted, run_info
from lidar_buildings.io.tiling.tile_grid import Buffer
from lidar_buildings.io.tiling.tile_store import KnownSurvey, SpooledTile
from lidar_buildings.io.tiling.tiling import TileSource
from lidar_buildings.pipeline.building_pool import BuildingPool

if TYPE_CHECKING:  # what takes time to import, and dask, which is there for those who ask for it
    from lidar_buildings.io.vectors.footprints import FootprintFile
    from lidar_buildings.pipeline.tile_cluster import TileCluster

#: Footprints so far from all points may still be asked for [m]; wide margin over 5 m.
_MARGIN = 10.0
#: So many tiles wait for a worker at most: wide margin over the workers, little memory for the scheduler.
_AHEAD = 1000


def run_local(
    request: RunRequest, footprints: FootprintFile | None, pool: BuildingPool | TileCluster
) -> RunOutcome:
    """
    Take a job from its inputs to its files.

    Each tile is done by one process while this one reads on; the buildings of the last one are shared out
    over a pool's processes. Workers of a cluster read the files too, and find the points in the output
    folder, which all of them see. LidarBuildingsError if it cannot begin or go on.
    """
    started = time.perf_counter()
    skip: set[int] = set()
    with _source(request, skip, pool) as source:
        folder = OutputFolder(
            request.output,
            source.inputs,
            source.frame,
            overwrite=request.overwrite,
            until=request.until,
            parameters=request.parameters(),
            footprints=footprints,
            files=request.files,
            use=request.use,
        )
        earlier = None
        if request.use is Use.UPDATE:
            earlier = earlier_buildings(folder.saved_tiles(), source.frame)
        else:
            skip.update(folder.on_disk)
        with progress_bar(lambda: source.tile_count - len(skip), is_quiet=request.is_quiet) as progress:
            tiles = _Tiles(progress)
            for tile in source.ready():
                work = _work(tile, folder, request, footprints, earlier)
                if isinstance(pool, BuildingPool) and source.is_last(tile):
                    tiles.finish(max(pool.n_workers - 1, 0))  # no more tiles in memory than processes
                    tiles.add(work, BuildingPool(0).submit(do_tile, work, pool))
                else:
                    tiles.add(work, pool.submit(do_tile, work))
                tiles.finish(_AHEAD)
            tiles.finish()
        if request.use is Use.UPDATE:
            folder.keep_only(source.stamps)
            note_survey(folder.path, asdict(source.known))
            if not request.is_quiet:
                n_tiles = counted(len(source.stamps), "tile")
                print(f"{tiles.n_unchanged} of {n_tiles} unchanged")
        from lidar_buildings.report.page_file import write_report

        seconds = {"wall": time.perf_counter() - started, **tiles.seconds}
        info = run_info(seconds, request.parameters(), tiles.failed, source.problems)
        summary = folder.finalise(
            info, pool.map, source.unreadable, has_failed=bool(tiles.failed), write_report=write_report
        )
        return RunOutcome(summary, tiles.failed)


def _source(request: RunRequest, skip: set[int], pool: BuildingPool | TileCluster) -> TileSource:
    """Open the inputs, with those of before where a survey is brought up to date."""
    shared: dict[str, Any] = {"keep": True}
    if not isinstance(pool, BuildingPool):
        shared = {"temporary": folder_of_points(request.output), "submit": pool.submit}
    inputs, known = list(request.inputs), None
    if request.use is Use.UPDATE:
        now = {file.resolve() for file in search_inputs(inputs)[0]}
        inputs = [*(str(one) for one in inputs_of_run(request.output) if one in now), *inputs]
        noted = recall_survey(request.output)
        known = KnownSurvey.from_json(noted) if noted else None
    return TileSource(inputs, request.tiling, skip=skip, known=known, crs=request.crs, **shared)


def _work(
    tile: SpooledTile,
    folder: OutputFolder,
    request: RunRequest,
    footprints: FootprintFile | None,
    earlier: Sequence[EarlierBuilding] | None,
) -> TileWork:
    near = before = None
    if footprints is not None:
        near = footprints.footprints.near(tile.area(tile.largest).grown(_MARGIN))
    if earlier is not None:
        anchors = np.array([one.anchor for one in earlier]).reshape(-1, 2).T
        before = [earlier[row] for row in np.flatnonzero(tile.area(Buffer.of(0.0)).holds(*anchors))]
    path = folder.tile_path(tile.stamp)
    return TileWork(tile.alone(), path, request.config, request.until, request.files, near, before)


class _Tiles:
    """
    The tiles of a run that are under way, and what became of the others.

    `failed` leads from the stamp of each tile that could not be processed to the reason; `n_unchanged` had
    the points of before, in a run that brings a survey up to date.
    """

    def __init__(self, progress: Callable[[int, TilesDone], None]) -> None:
        self.seconds: Counter[str] = Counter()
        self.failed: dict[int, str] = {}
        self.n_unchanged = 0
        self._progress = progress
        self._n_done, self._so_far = 0, TilesDone()
        self._waiting: dict[Future[TileOutcome], TileWork] = {}
        # to wait for many futures takes time for each of them
        self._answered: SimpleQueue[Future[TileOutcome]] = SimpleQueue()

    def add(self, work: TileWork, answer: Future[TileOutcome]) -> None:
        """Take a tile that is under way."""
        self._waiting[answer] = work
        answer.add_done_callback(self._answered.put)

    def finish(self, n_left: int = 0) -> None:
        """Note what has become of tiles until no more than so many are under way; a full disk ends all."""
        while len(self._waiting) > n_left or not self._answered.empty():
            answer = self._answered.get()
            work = self._waiting.pop(answer)
            try:
                outcome = answer.result()
            except LidarBuildingsError:
                raise
            except Exception as error:
                self.failed[work.tile.stamp] = f"{type(error).__name__}: {' '.join(str(error).split())}"
                continue
            self.seconds.update(outcome.seconds)
            self._n_done += 1
            self.n_unchanged += outcome.is_unchanged
            found = (not outcome.is_unchanged, outcome.n_points, outcome.n_buildings)
            self._so_far = TilesDone(*map(sum, zip(self._so_far, found, strict=True)))
            self._progress(self._n_done, self._so_far)
