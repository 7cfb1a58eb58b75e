"""A run without ROS: tiles through the pipeline in several processes, into the same files as the graph."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import TYPE_CHECKING, Any

from lidar_buildings.commands.progress import RunOutcome, progress_bar
from lidar_buildings.commands.run_request import RunRequest
from lidar_buildings.commands.tile_work import TileOutcome, TileWork, done, done_far
from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.stages.footprints import Footprints
from lidar_buildings.core.stages.terrain import RasterConfig
from lidar_buildings.io.results.output_folder import OutputFolder
from lidar_buildings.io.results.run_folder import check_folder, folder_of_points
from lidar_buildings.io.results.run_summary import run_info
from lidar_buildings.io.tiling.spooled_tile import SpooledTile
from lidar_buildings.io.tiling.tiling import TileSource
from lidar_buildings.io.vectors.footprints import FootprintFile
from lidar_buildings.pipeline.building_pool import BuildingPool, NoWorkerError
from lidar_buildings.pipeline.reconstruct import PipelineConfig

if TYPE_CHECKING:  # dask is there for those who ask for it
    from lidar_buildings.pipeline.tile_cluster import TileCluster

#: Footprints so far from all points may still be asked for [m]; wide margin over 5 m.
_MARGIN = 10.0

_Answer = Future[TileOutcome | LidarBuildingsError]


def run_local(
    request: RunRequest, footprints: FootprintFile | None, pool: BuildingPool | TileCluster
) -> RunOutcome:
    """
    Take a job from its inputs to its files.

    Workers of a cluster read the files too, and find the points in the output folder, which all of them see.

    Raises
    ------
    LidarBuildingsError
        If it cannot begin or go on.
    """
    started = time.perf_counter()
    skip: set[int] = set()
    shared: dict[str, Any] = {}
    if not isinstance(pool, BuildingPool):
        check_folder(request.output, overwrite=request.overwrite)
        shared = {"temporary": folder_of_points(request.output), "submit": pool.submit}
    with TileSource(request.inputs, request.tiling, skip=skip, **shared) as source:
        folder = OutputFolder(
            request.output,
            source.inputs,
            source.frame,
            overwrite=request.overwrite,
            until=request.until,
            parameters=request.parameters(),
            footprints=footprints,
            formats=request.files.formats,
            terrain_tolerance=request.files.terrain_tolerance,
        )
        skip.update(folder.done_stamps())
        with progress_bar(lambda: source.tile_count - len(skip)) as progress:
            seconds, failed = process_tiles(
                source,
                folder,
                request.config,
                request.until,
                progress,
                request.files,
                None if footprints is None else footprints.footprints,
                pool,
            )
        seconds = {"wall": time.perf_counter() - started, **seconds}
        info = run_info(seconds, request.parameters(), failed, source.problems)
        return RunOutcome(folder.finalise(info, pool.call_each, source.unreadable), failed)


def process_tiles(
    source: TileSource,
    folder: OutputFolder,
    config: PipelineConfig,
    until: str,
    progress: Callable[[int], None],
    rasters: RasterConfig | None = None,
    footprints: Footprints | None = None,
    pool: BuildingPool | TileCluster | None = None,
) -> tuple[dict[str, float], dict[int, str]]:
    """
    Take every tile of a source to disk.

    Each tile is done by one of the pool's processes while this one reads on; of a tile that is alone
    the others share the buildings.

    Parameters
    ----------
    source : TileSource
        Where tiles come from; finished ones are skipped by it.
    folder : OutputFolder
        Where they go.
    config : PipelineConfig
        Of all stages.
    until : str
        The last stage.
    progress : callable
        Told the number of finished tiles after each.
    rasters : RasterConfig, optional
        Of the rasters.
    footprints : Footprints, optional
        Outlines to use instead of tracing.
    pool : BuildingPool or TileCluster, optional
        The processes; everything is done here, tile after tile, without.

    Returns
    -------
    seconds : dict
        Stage → seconds in all, of all processes.
    failed : dict
        Stamp of each tile that could not be processed → why; the others are complete.
    """
    seconds: Counter[str] = Counter()
    failed: dict[int, str] = {}
    waiting: dict[_Answer, TileWork] = {}
    n_done = 0

    def finish(answers: set[_Answer]) -> None:
        nonlocal n_done
        for answer in answers:
            work = waiting.pop(answer)
            outcome = _outcome(answer, work)
            seconds.update(outcome.seconds)
            if outcome.reason:
                failed[work.tile.stamp] = outcome.reason
            else:
                n_done += 1
                progress(n_done)

    processes = pool or BuildingPool(0)
    do, how = (done, {}) if isinstance(processes, BuildingPool) else (done_far, {"is_soon": True})
    for tile in source.ready():
        path, near = folder.tile_path(tile.stamp), _near(footprints, tile)
        is_only = source.tile_count == 1
        work = TileWork(tile.alone(), path, config, until, rasters or RasterConfig(), near, is_only)
        waiting[processes.submit(do, work, **how)] = work
        finish(wait(waiting, timeout=0).done)
    if processes.n_alive:
        folder.load_writers()
    while waiting:
        finish(wait(waiting, return_when=FIRST_COMPLETED).done)
    return dict(seconds), failed


def _outcome(answer: _Answer, work: TileWork) -> TileOutcome:
    """Return what became of a tile, which is done here where no process was left to do it."""
    try:
        outcome = answer.result()
    except NoWorkerError:
        outcome = done(work)
    except LidarBuildingsError:
        raise
    except Exception as error:
        return TileOutcome({}, f"{type(error).__name__}: {' '.join(str(error).split())}")
    if isinstance(outcome, LidarBuildingsError):
        raise outcome
    return outcome


def _near(footprints: Footprints | None, tile: SpooledTile) -> Footprints | None:
    """Return the footprints that a tile may have points of."""
    if footprints is None:
        return None
    area = tile.reach.grown(_MARGIN)
    return footprints.near((area.x_min, area.y_min, area.x_max, area.y_max))
