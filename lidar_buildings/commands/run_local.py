"""A run without ROS: tiles through the pipeline in several processes, into the same files as the graph."""

from __future__ import annotations

import importlib
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import asdict
from functools import partial
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lidar_buildings.commands.progress import RunOutcome, TilesDone, progress_bar
from lidar_buildings.commands.run_request import RunRequest
from lidar_buildings.commands.tile_update import EarlierBuilding, earlier_buildings
from lidar_buildings.commands.tile_work import TileOutcome, TileWork, done
from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.stages.footprints.footprints import Footprints
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
from lidar_buildings.io.tiling.spooled_tile import SpooledTile
from lidar_buildings.io.tiling.tile_grid import Buffer
from lidar_buildings.io.tiling.tile_store import KnownSurvey
from lidar_buildings.io.tiling.tiling import TileSource
from lidar_buildings.pipeline.building_pool import BuildingPool

if TYPE_CHECKING:  # what takes time to import, and dask, which is there for those who ask for it
    from lidar_buildings.io.vectors.footprints import FootprintFile
    from lidar_buildings.pipeline.tile_cluster import TileCluster

#: Footprints so far from all points may still be asked for [m]; wide margin over 5 m.
_MARGIN = 10.0

#: So many tiles wait for a worker at most: wide margin over the workers, little memory for the scheduler.
_AHEAD = 1000

_Answer = Future[TileOutcome]


def run_local(
    request: RunRequest, footprints: FootprintFile | None, pool: BuildingPool | TileCluster
) -> RunOutcome:
    """
    Take a job from its inputs to its files.

    Workers of a cluster read the files too, and find the points in the output folder, which all of them see.
    LidarBuildingsError if it cannot begin or go on.
    """
    started = time.perf_counter()
    skip: set[int] = set()
    shared: dict[str, Any] = {"keep": True}
    if not isinstance(pool, BuildingPool):
        reads = partial(pool.submit, is_late=True)
        shared = {"temporary": folder_of_points(request.output), "submit": reads}
    inputs, known = list(request.inputs), None
    if request.use is Use.UPDATE:
        now = {file.resolve() for file in search_inputs(inputs)[0]}
        inputs = [*(str(one) for one in inputs_of_run(request.output) if one in now), *inputs]
        noted = recall_survey(request.output)
        known = KnownSurvey.from_json(noted) if noted else None
    with TileSource(inputs, request.tiling, skip=skip, known=known, crs=request.crs, **shared) as source:
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
            given = None if footprints is None else footprints.footprints
            done = process_tiles(source, folder, request, progress, given, pool, earlier)
        if request.use is Use.UPDATE:
            folder.keep_only(source.stamps)
            note_survey(folder.path, asdict(source.known))
            if not request.is_quiet:
                print(f"{done.n_unchanged} of {counted(len(source.stamps), 'tile')} had the points of before")
        from lidar_buildings.report.page_file import write_report

        seconds = {"wall": time.perf_counter() - started, **done.seconds}
        info = run_info(seconds, request.parameters(), done.failed, source.problems)
        summary = folder.finalise(
            info,
            pool.call_each,
            source.unreadable,
            has_failed=bool(done.failed),
            write_report=partial(write_report, share=pool.call_each),
        )
        return RunOutcome(summary, done.failed)


class Processed(NamedTuple):
    """What became of a source's tiles."""

    seconds: dict[str, float]  #: stage → seconds in all, of all processes
    failed: dict[int, str]  #: stamp of each tile that could not be processed → why; the others are complete
    n_unchanged: int  #: tiles that had the points of before, of a run that is brought up to date


def process_tiles(
    source: TileSource,
    folder: OutputFolder,
    request: RunRequest,
    progress: Callable[[int, TilesDone], None],
    footprints: Footprints | None,
    pool: BuildingPool | TileCluster,
    earlier: Sequence[EarlierBuilding] | None,
) -> Processed:
    """
    Take every tile of a source to disk.

    Each tile is done by one of the pool's processes while this one reads on; of a tile that is alone the
    others share the buildings. `progress` is told the number of finished tiles, and what they hold, after
    each; `earlier` is of the state of a survey that is brought up to date.
    """
    seconds: Counter[str] = Counter()
    failed: dict[int, str] = {}
    waiting: dict[_Answer, TileWork] = {}
    answered: SimpleQueue[_Answer] = SimpleQueue()  # to wait for many futures takes time for each of them
    n_done = n_unchanged = 0
    so_far = TilesDone()

    def finish() -> None:
        nonlocal n_done, n_unchanged, so_far
        answer = answered.get()
        work = waiting.pop(answer)
        outcome = _outcome(answer)
        seconds.update(outcome.seconds)
        if outcome.reason:
            failed[work.tile.stamp] = outcome.reason
        else:
            n_done += 1
            n_unchanged += outcome.is_unchanged
            found = (not outcome.is_unchanged, outcome.n_points, outcome.n_buildings)
            so_far = TilesDone(*map(sum, zip(so_far, found, strict=True)))
            progress(n_done, so_far)

    anchors = np.array([one.anchor for one in earlier or ()]).reshape(-1, 2).T
    for tile in source.ready():
        path, near, before = folder.tile_path(tile.stamp), _near(footprints, tile), None
        if earlier is not None:
            before = [earlier[row] for row in np.flatnonzero(tile.area(Buffer.of(0.0)).holds(*anchors))]
        work = TileWork(tile.alone(), path, request.config, request.until, request.files, near, before)
        answer = pool.submit(done, work, shares=True)
        waiting[answer] = work
        answer.add_done_callback(answered.put)
        while len(waiting) > _AHEAD or not answered.empty():
            finish()
    if pool.n_alive:
        folder.load_writers()
        importlib.import_module("lidar_buildings.report.page_file")
    while waiting:
        finish()
    return Processed(dict(seconds), failed, n_unchanged)


def _outcome(answer: _Answer) -> TileOutcome:
    """Return what became of a tile; a LidarBuildingsError, as of a full disk, ends the whole run."""
    try:
        return answer.result()
    except LidarBuildingsError:
        raise
    except Exception as error:
        return TileOutcome({}, f"{type(error).__name__}: {' '.join(str(error).split())}")


def _near(footprints: Footprints | None, tile: SpooledTile) -> Footprints | None:
    """Return the footprints that a tile may have points of."""
    if footprints is None:
        return None
    return footprints.near(tile.area(tile.largest).grown(_MARGIN))
