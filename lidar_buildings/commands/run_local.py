"""A run without ROS: tile after tile through the pipeline, into the same files as the graph writes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace

from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.stage_table import STAGES
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.footprints import Footprints
from lidar_buildings.core.stages.terrain import RasterConfig
from lidar_buildings.io.models.cityjson import feature_line
from lidar_buildings.io.results.output_folder import OutputFolder
from lidar_buildings.io.results.tile_products import TileProducts
from lidar_buildings.io.tiling.tiling import TileSource
from lidar_buildings.pipeline.building_pool import BuildingPool
from lidar_buildings.pipeline.reconstruct import PipelineConfig, TileResult, reconstruct_tile, with_models
from lidar_buildings.pipeline.tile_rasters import rasterise_tile


def process_tiles(
    source: TileSource,
    folder: OutputFolder,
    config: PipelineConfig,
    until: str,
    progress: Callable[[int], None],
    rasters: RasterConfig | None = None,
    footprints: Footprints | None = None,
    pool: BuildingPool | None = None,
) -> tuple[dict[str, float], dict[int, str]]:
    """
    Take every tile of a source to disk.

    While a tile goes through the stages the next one is read, and the models and rasters of the one before
    are made and saved.

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
    pool : BuildingPool, optional
        Processes that share the buildings.

    Returns
    -------
    seconds : dict
        Stage → seconds in all.
    failed : dict
        Stamp of each tile that could not be processed → why; the others are complete.
    """
    seconds: Counter[str] = Counter()
    failed: dict[int, str] = {}
    n_done = 0

    def finish(stamp: int, saved: Future[TileResult]) -> None:
        nonlocal n_done
        try:
            seconds.update(saved.result().seconds)
        except LidarBuildingsError:
            raise
        except Exception as error:
            failed[stamp] = f"{type(error).__name__}: {' '.join(str(error).split())}"
        else:
            n_done += 1
            progress(n_done)

    def save(result: TileResult) -> TileResult:
        if until == STAGES[-1]:
            result = with_models(result, config.building_model, pool)
        folder.write_tile(products_of(result, source.frame, rasters or RasterConfig()))
        return result

    last = until if until != STAGES[-1] else STAGES[-2]
    waiting: tuple[int, Future[TileResult]] | None = None
    with ThreadPoolExecutor(1) as behind, closing(_read_ahead(source)) as tiles:
        for tile in tiles:
            stamp = tile.stamp
            done: Future[TileResult] = Future()
            try:
                result = whole_result(source, tile, config, last, footprints, pool)
            except Exception as error:
                done.set_exception(error)
            else:
                done = behind.submit(save, result)
                del result
            del tile
            if waiting is not None:
                finish(*waiting)
            waiting = stamp, done
        if waiting is not None:
            finish(*waiting)
    return dict(seconds), failed


def _read_ahead(source: TileSource) -> Iterator[PointTile]:
    """Yield a source's tiles; while one is used the next is read."""
    tiles = iter(source)
    with ThreadPoolExecutor(1) as reader:
        coming = reader.submit(next, tiles, None)
        try:
            while (tile := coming.result()) is not None:
                coming = reader.submit(next, tiles, None)
                yield tile
                del tile
        finally:
            if not coming.done():
                source.close()


def whole_result(
    source: TileSource,
    tile: PointTile,
    config: PipelineConfig,
    until: str,
    footprints: Footprints | None = None,
    pool: BuildingPool | None = None,
) -> TileResult:
    """Process a tile, with a larger buffer as long as one of its buildings is not whole."""
    result = reconstruct_tile(tile, config, until=until, footprints=footprints, pool=pool)
    while result.clipped:
        larger = source.grown(tile.stamp)
        # What cannot grow is all there is: no limit is left to reach.
        tile = larger if larger is not None else replace(tile, bounds=None)
        result = reconstruct_tile(tile, config, until=until, footprints=footprints, pool=pool)
    return result


def products_of(result: TileResult, frame: MapFrame, rasters: RasterConfig) -> TileProducts:
    """Gather what a tile's files need."""
    features = [
        feature_line(one.model, one.building_id, frame, one.attributes, anchor=one.anchor)
        for one in result.models
    ]
    return TileProducts.from_tiles(
        result.classified,
        result.roofs,
        result.traced,
        result.outlines,
        features,
        rasterise_tile(result.classified, rasters, frame),
    )
