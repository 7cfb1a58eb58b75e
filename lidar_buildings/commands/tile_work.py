"""What a run without ROS does with one tile, in whatever process: from its points to its saved products."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from lidar_buildings.commands.tile_update import (
    EarlierBuilding,
    digest_of,
    is_unchanged,
    with_kept_ids,
    write_digests,
)
from lidar_buildings.core.freed_memory import give_memory_back
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.footprints.footprints import Footprints
from lidar_buildings.core.stages.terrain.config import RasterConfig
from lidar_buildings.core.stages.terrain.rasters import TerrainRasters
from lidar_buildings.io.models.cityjson import feature_line
from lidar_buildings.io.results.tile_products import TileProducts
from lidar_buildings.io.tiling.tile_grid import Buffer
from lidar_buildings.io.tiling.tile_store import SpooledTile
from lidar_buildings.pipeline.building_pool import BuildingPool
from lidar_buildings.pipeline.config import PipelineConfig
from lidar_buildings.pipeline.reconstruct import TileResult, reconstruct_tile
from lidar_buildings.pipeline.tile_rasters import rasterise_tile


@dataclass(frozen=True)
class TileWork:
    """What is done with a tile."""

    tile: SpooledTile  #: its points
    path: Path  #: where its products are saved
    config: PipelineConfig  #: of all stages
    until: str  #: the last stage
    rasters: RasterConfig  #: of the rasters
    footprints: Footprints | None  #: outlines to use instead of tracing
    #: Those of an earlier state of the survey, where one is brought up to date.
    earlier: Sequence[EarlierBuilding] | None


class TileOutcome(NamedTuple):
    """Seconds by stage and what was found, or that the tile has the points of before."""

    seconds: dict[str, float]
    is_unchanged: bool = False
    n_points: int = 0
    n_buildings: int = 0


def do_tile(work: TileWork, pool: BuildingPool | None = None) -> TileOutcome:
    """
    Take a tile from its points to its saved products, with a larger buffer until its buildings are whole.

    Its buildings are shared out over a pool if there is one. What it raises is why there are no products.
    """
    if work.earlier is not None and is_unchanged(work.tile, work.path):
        return TileOutcome({}, is_unchanged=True)
    frame = work.tile.store.frame
    digests: list[tuple[Buffer, str]] = []
    rasters: list[Future[TerrainRasters | None]] = []
    with ThreadPoolExecutor(1) as beside:  # rasters are made of the classes alone

        def begin(classified: PointTile) -> None:
            rasters.append(beside.submit(rasterise_tile, classified, work.rasters, frame))

        result = None
        while result is None or result.clipped:
            result = None  # one at a time in memory
            tile = work.tile.read()
            if work.earlier is not None:
                digests.append((work.tile.buffer, digest_of(tile)))
            result = reconstruct_tile(
                tile,
                work.config,
                until=work.until,
                footprints=work.footprints,
                pool=pool,
                on_classified=begin,
                is_all=lambda sides: not work.tile.grow(sides),
            )
            del tile
        if not rasters:  # no stage has followed
            begin(result.classified)
    if work.earlier is not None:
        result = with_kept_ids(result, work.earlier)
    products = products_of(result, frame, rasters[-1].result())
    products.save(work.path)
    if digests:
        write_digests(work.path, digests)
    outcome = TileOutcome(result.seconds, n_points=len(products.core), n_buildings=products.n_buildings)
    del result, products
    rasters.clear()
    give_memory_back()
    return outcome


def products_of(result: TileResult, frame: MapFrame, rasters: TerrainRasters | None) -> TileProducts:
    """Gather what a tile's files need."""
    features = [
        feature_line(one.model, one.building_id, frame, one.attributes, anchor=one.anchor)
        for one in result.models
    ]
    return TileProducts.from_tiles(
        result.classified, result.roofs, result.traced, result.outlines, features, rasters
    )
