"""What a run without ROS does with one tile, in whatever process: from its points to its saved products."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from lidar_buildings.core.freed_memory import give_memory_back
from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.parallel import work_alone
from lidar_buildings.core.stages.footprints import Footprints
from lidar_buildings.core.stages.terrain import RasterConfig, TerrainRasters
from lidar_buildings.io.models.cityjson import feature_line
from lidar_buildings.io.results.tile_products import TileProducts
from lidar_buildings.io.tiling.spooled_tile import SpooledTile
from lidar_buildings.pipeline.reconstruct import PipelineConfig, TileResult, reconstruct_tile
from lidar_buildings.pipeline.sharing import Sharing
from lidar_buildings.pipeline.tile_rasters import rasterise_tile


@dataclass(frozen=True)
class TileWork:
    """
    What is done with a tile.

    Attributes
    ----------
    tile : SpooledTile
        Its points.
    path : Path
        Where its products are saved.
    config : PipelineConfig
        Of all stages.
    until : str
        The last stage.
    rasters : RasterConfig
        Of the rasters.
    footprints : Footprints or None
        Outlines to use instead of tracing.
    is_only : bool
        Whether there is no other tile, so that the other cores have nothing else to do.
    """

    tile: SpooledTile
    path: Path
    config: PipelineConfig
    until: str
    rasters: RasterConfig = field(default_factory=RasterConfig)
    footprints: Footprints | None = None
    is_only: bool = False


class TileOutcome(NamedTuple):
    """Seconds by stage, or why a tile failed."""

    seconds: dict[str, float]
    reason: str = ""


def done_far(work: TileWork, pool: None = None) -> TileOutcome | LidarBuildingsError:
    """Do as `done` where the same work may be done elsewhere at the same time: the later one's file stays."""
    own = work.path.with_name(f".{uuid.uuid4().hex}{work.path.suffix}")
    outcome = done(replace(work, path=own))
    if own.exists():
        own.replace(work.path)
    return outcome


def done(work: TileWork, pool: Sharing | None = None) -> TileOutcome | LidarBuildingsError:
    """Take a tile from its points to its saved products; return what ends the whole run."""
    was_alone = work_alone(not work.is_only)
    frame = work.tile.store.frame
    rasters: list[Future[TerrainRasters | None]] = []
    try:
        with ThreadPoolExecutor(1) as beside:  # rasters are made of the classes alone

            def begin(classified: PointTile) -> None:
                give_memory_back()
                rasters.append(beside.submit(rasterise_tile, classified, work.rasters, frame))

            result = whole_result(work.tile, work.config, work.until, work.footprints, pool, begin)
        products_of(result, frame, rasters[-1].result()).save(work.path)
    except LidarBuildingsError as error:
        return error
    except Exception as error:
        return TileOutcome({}, f"{type(error).__name__}: {' '.join(str(error).split())}")
    finally:
        work_alone(was_alone)
    seconds = result.seconds
    del result
    rasters.clear()
    give_memory_back()
    return TileOutcome(seconds)


def whole_result(
    spooled: SpooledTile,
    config: PipelineConfig,
    until: str,
    footprints: Footprints | None = None,
    pool: Sharing | None = None,
    on_classified: Callable[[PointTile], object] | None = None,
) -> TileResult:
    """Process a tile, with a larger buffer as long as one of its buildings is not whole."""
    while True:
        result = reconstruct_tile(
            spooled.read(),
            config,
            until=until,
            footprints=footprints,
            pool=pool,
            on_classified=on_classified,
            is_all=lambda: not spooled.grow(),
        )
        if not result.clipped:
            return result
        del result  # one at a time in memory


def products_of(result: TileResult, frame: MapFrame, rasters: TerrainRasters | None) -> TileProducts:
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
        rasters,
    )
