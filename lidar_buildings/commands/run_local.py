"""A run without ROS: tile after tile through the pipeline, into the same files as the graph writes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.footprints import Footprints
from lidar_buildings.core.stages.terrain import RasterConfig
from lidar_buildings.io.models.cityjson import feature_line
from lidar_buildings.io.results.output_folder import OutputFolder
from lidar_buildings.io.results.tile_products import TileProducts
from lidar_buildings.io.tiling.tiling import TileSource
from lidar_buildings.pipeline.reconstruct import PipelineConfig, TileResult, reconstruct_tile
from lidar_buildings.pipeline.tile_rasters import rasterise_tile


def process_tiles(
    source: TileSource,
    folder: OutputFolder,
    config: PipelineConfig,
    until: str,
    progress: Callable[[int], None],
    rasters: RasterConfig | None = None,
    footprints: Footprints | None = None,
) -> tuple[dict[str, float], dict[int, str]]:
    """
    Take every tile of a source to disk.

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

    Returns
    -------
    seconds : dict
        Stage → seconds in all.
    failed : dict
        Stamp of each tile that could not be processed → why; the others are complete.
    """
    seconds: Counter[str] = Counter()
    failed: dict[int, str] = {}
    for number, tile in enumerate(source, start=1):
        try:
            result = whole_result(source, tile, config, until, footprints)
            products = products_of(result, source.frame, rasters or RasterConfig())
        except LidarBuildingsError:
            raise
        except Exception as error:
            failed[tile.stamp] = f"{type(error).__name__}: {' '.join(str(error).split())}"
            continue
        folder.write_tile(products)
        seconds.update(result.seconds)
        progress(number - len(failed))
    return dict(seconds), failed


def whole_result(
    source: TileSource,
    tile: PointTile,
    config: PipelineConfig,
    until: str,
    footprints: Footprints | None = None,
) -> TileResult:
    """Process a tile, with a larger buffer as long as one of its buildings is not whole."""
    result = reconstruct_tile(tile, config, until=until, footprints=footprints)
    while result.clipped:
        larger = source.grown(tile.stamp)
        # What cannot grow is all there is: no limit is left to reach.
        tile = larger if larger is not None else replace(tile, bounds=None)
        result = reconstruct_tile(tile, config, until=until, footprints=footprints)
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
