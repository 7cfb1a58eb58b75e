"""What a run without ROS does with one tile, in whatever process: from its points to its saved products."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely

from lidar_buildings.core.freed_memory import give_memory_back
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.outline import BuildingOutline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.footprints.footprints import Footprints
from lidar_buildings.core.stages.terrain.config import RasterConfig
from lidar_buildings.core.stages.terrain.rasters import TerrainRasters
from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.io.files.reference_systems import model_frame
from lidar_buildings.io.models.cityjson import feature_line
from lidar_buildings.io.results.tile_products import TileProducts, load_shapes
from lidar_buildings.io.tiling.tile_grid import Buffer
from lidar_buildings.io.tiling.tile_store import SpooledTile
from lidar_buildings.pipeline.building_pool import BuildingPool
from lidar_buildings.pipeline.config import PipelineConfig
from lidar_buildings.pipeline.reconstruct import TileResult, reconstruct_tile
from lidar_buildings.pipeline.tile_stages import rasterise_tile

#: What beside a saved tile tells of the points that it was made from, those of each buffer that it grew to.
_ENDING = ".points"
#: The id in a line of the city model, whose coordinates are those of the building's anchor.
_NAME = re.compile(r'"id":"building-(-?\d+\.\d)-(-?\d+\.\d)"')
_NUMBER = re.compile(r'"building_id":(\d+)')
#: A building keeps the id of one with which it shares more than this part of both: there is at most one.
_SHARED = 0.5


def digest_of(tile: PointTile) -> str:
    """Return what tells a tile's points, and all else that its result depends on, from any others."""
    known = tile.point_spacing, tile.dark_limit, tile.bounds, tile.frame, tile.stamp
    digest = hashlib.blake2b(repr(known).encode(), digest_size=16)
    for name, column in {"points": tile.points, **tile.columns}.items():
        digest.update(f"{name} {column.shape}".encode())
        digest.update(np.ascontiguousarray(column).data)
    return digest.hexdigest()


def is_unchanged(tile: SpooledTile, saved: Path) -> bool:
    """Whether a tile was saved, and from the points that it has."""
    try:
        digests = json.loads(saved.with_suffix(_ENDING).read_text())
    except (OSError, ValueError):
        return False
    grown = ((replace(tile, buffer=Buffer(*buffer)), digest) for buffer, digest in digests)
    return saved.exists() and bool(digests) and all(digest_of(one.read()) == digest for one, digest in grown)


class EarlierBuilding(NamedTuple):
    """A building of an earlier result, in the map frame [m]."""

    number: int  #: its id
    anchor: tuple[float, float]  #: the position that the id is made from
    polygon: shapely.Polygon


def earlier_buildings(tiles: Iterable[Path], frame: MapFrame) -> list[EarlierBuilding]:
    """Read those that have models from saved tiles."""
    found = []
    for path in tiles:
        shapes = load_shapes(path)
        polygons = {one.building_id: one.outline.polygon for one in shapes.outlines}
        for line in shapes.features:
            name, number = _NAME.search(line), _NUMBER.search(line)
            if name and number and int(number[1]) in polygons:
                x, y, _ = frame.to_map(np.array([[float(name[1]), float(name[2]), 0.0]]))[0].tolist()
                found.append(EarlierBuilding(int(number[1]), (x, y), polygons[int(number[1])]))
    return found


def with_kept_ids(result: TileResult, earlier: Sequence[EarlierBuilding]) -> TileResult:
    """
    Give buildings the ids that they had, where their westernmost points are others now.

    The earlier ones had their anchors in the tile: no other tile can give their ids to another building.
    """
    natural = {one.building_id for one in result.outlines}
    known = {old.number for old in earlier}
    kept: dict[int, EarlierBuilding] = {}
    for old in earlier:
        if old.number not in natural:
            shared = {
                one.building_id: shapely.intersection(old.polygon, one.outline.polygon).area
                / max(old.polygon.area, one.outline.area)
                for one in result.outlines
                if old.polygon.intersects(one.outline.polygon)
            }
            same = max(shared, key=lambda one: shared[one], default=0)
            if shared.get(same, 0.0) > _SHARED and same not in known:
                kept[same] = old
    if not kept:
        return result
    number_of = {new: old.number for new, old in kept.items()}
    roofs = result.roofs
    if roofs is not None and roofs.building_id is not None:
        ids, place = np.unique(roofs.building_id, return_inverse=True)
        named = np.array([number_of.get(one, one) for one in ids.tolist()], dtype=np.uint32)
        roofs = roofs.with_columns(building_id=named[place])
    models = [
        replace(one, building_id=kept[one.building_id].number, anchor=kept[one.building_id].anchor)
        if one.building_id in kept
        else one
        for one in result.models
    ]

    def renumbered(outlines: Iterable[BuildingOutline]) -> tuple[BuildingOutline, ...]:
        named = [
            replace(one, building_id=number_of.get(one.building_id, one.building_id)) for one in outlines
        ]
        return tuple(sorted(named, key=lambda one: one.building_id))

    return replace(
        result,
        roofs=roofs,
        traced=renumbered(result.traced),
        outlines=renumbered(result.outlines),
        models=tuple(sorted(models, key=lambda one: one.building_id)),
    )


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
        with atomic_file(work.path.with_suffix(_ENDING), has_rivals=True) as temporary:
            temporary.write_text(json.dumps(digests))
    outcome = TileOutcome(result.seconds, n_points=len(products.core), n_buildings=products.n_buildings)
    del result, products
    rasters.clear()
    give_memory_back()
    return outcome


def products_of(result: TileResult, frame: MapFrame, rasters: TerrainRasters | None) -> TileProducts:
    """Gather what a tile's files need."""
    models = model_frame(frame)
    features = [
        feature_line(one.model, one.building_id, models, one.attributes, anchor=one.anchor)
        for one in result.models
    ]
    return TileProducts.from_tiles(
        result.classified,
        result.roofs,
        result.traced,
        result.outlines,
        features,
        result.facades,
        rasters,
    )
