"""The order of the stages for one tile, without ROS."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

from lidar_buildings.core.model.outline import BuildingOutline
from lidar_buildings.core.model.sides import NONE, Sides
from lidar_buildings.core.model.stage_table import STAGES
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.facades.facade import Facade
from lidar_buildings.core.stages.footprints.footprints import Footprints
from lidar_buildings.pipeline.building_pool import BuildingPool
from lidar_buildings.pipeline.config import PipelineConfig
from lidar_buildings.pipeline.tile_facades import find_tile_facades, street_points
from lidar_buildings.pipeline.tile_models import TileModel, build_models
from lidar_buildings.pipeline.tile_outlines import regularise_outlines
from lidar_buildings.pipeline.tile_stages import (
    filter_ground,
    fit_planes,
    label_roof_edges,
    roof_points,
    select_roof_points,
)
from lidar_buildings.pipeline.tile_tracing import trace_footprints, trace_or_close


@dataclass(frozen=True, eq=False)
class TileResult:
    """All that the chain made of one tile; members of stages that were not run are None or empty."""

    classified: PointTile  #: every point of the tile with its class and height above ground
    #: The points of class 6 with edge labels, building and plane ids as far as the chain went.
    roofs: PointTile | None = None
    #: Before and after regularisation, by rising building id.
    traced: tuple[BuildingOutline, ...] = ()
    outlines: tuple[BuildingOutline, ...] = ()
    facades: tuple[Facade, ...] = ()  #: walls seen from the street, context too
    models: tuple[TileModel, ...] = ()  #: one per outline
    #: On which sides a building of this tile, or what may be one, reaches beyond it; the chain then ends with
    #: the stage that found it.
    clipped: Sides = NONE
    seconds: dict[str, float] = field(default_factory=dict)  #: stage name → seconds it took


def reconstruct_tile(
    tile: PointTile,
    config: PipelineConfig | None = None,
    *,
    until: str = STAGES[-1],
    footprints: Footprints | None = None,
    pool: BuildingPool | None = None,
    on_classified: Callable[[PointTile], object] | None = None,
    is_all: Callable[[Sides], bool] = lambda _: False,
) -> TileResult:
    """
    Take one tile from raw points to models: the same numbers as the node graph gives for it.

    `until` is the last stage to run, one of `STAGES`, ValueError if it is none. Footprints are used as they
    are instead of tracing and regularising. Buildings are shared out over the processes of a pool if there is
    one. `on_classified` is called with the tile and its classes once it is sure to be large enough, if more
    stages follow. `is_all` is asked when a building, or what may be one, reaches beyond some sides of the
    tile: whether nothing lies there, so that the chain goes on.
    """
    if until not in STAGES:
        raise ValueError(f"until = {until!r}: must be one of {', '.join(STAGES)}")
    seconds, started = dict[str, float](), time.perf_counter()
    stages = _results(tile, config or PipelineConfig(), footprints, pool, on_classified)
    for stage, result in zip(STAGES, stages, strict=True):
        seconds[stage], started = time.perf_counter() - started, time.perf_counter()
        clipped = NONE if result.clipped and is_all(result.clipped) else result.clipped
        if clipped or stage == until:
            break
    return replace(result, clipped=clipped, seconds=seconds)


def _results(
    tile: PointTile,
    config: PipelineConfig,
    footprints: Footprints | None,
    pool: BuildingPool | None,
    on_classified: Callable[[PointTile], object] | None,
) -> Iterator[TileResult]:
    """Apply one stage after the other, and yield what there is after each."""
    filtered = filter_ground(tile, config.ground_filter)
    yield TileResult(filtered.tile, clipped=filtered.clipped)

    classified = select_roof_points(filtered.tile, config.roof_selection)
    roofs = roof_points(classified)
    yield TileResult(classified, roofs)

    roofs = label_roof_edges(roofs, config.edge_labelling).tile
    yield TileResult(classified, roofs)

    if footprints is None:
        found = trace_or_close(roofs, config.segmentation, config.boundary_tracing, pool)
    else:
        found = trace_footprints(classified, roofs, footprints, config.footprints, config.edge_labelling)
    roofs, traced = found.tile, found.outlines
    yield TileResult(classified, roofs, traced, clipped=found.clipped)

    if on_classified is not None:
        on_classified(classified)
    regularisation = config.regularisation
    if footprints is not None:
        regularisation = replace(regularisation, keep_outlines=True)
    outlines = regularise_outlines(traced, regularisation, pool)
    yield TileResult(classified, roofs, traced, outlines)

    facades = find_tile_facades(street_points(classified), outlines, config.facades)
    yield TileResult(classified, roofs, traced, outlines, facades)

    roofs = fit_planes(roofs, config.plane_fitting, pool)
    yield TileResult(classified, roofs, traced, outlines, facades)

    models = build_models(roofs, outlines, config.building_model, pool, facades=facades)
    yield TileResult(classified, roofs, traced, outlines, facades, models)
