"""One call of each stage, on a tile so small that what takes time is the compiling."""

from __future__ import annotations

from functools import cache

import numpy as np

from lidar_buildings.commands.sample_tile import sample_tile
from lidar_buildings.core.neighbours.columns import by_column
from lidar_buildings.core.neighbours.point_spacing import quantised_spacing
from lidar_buildings.core.neighbours.scan_pattern import ScanPattern
from lidar_buildings.core.scans.motion import place_points
from lidar_buildings.core.scans.trajectory import Pose
from lidar_buildings.core.solids.validity import check_solid
from lidar_buildings.core.stages.boundary_tracing.point_grid import build_point_grid
from lidar_buildings.core.stages.boundary_tracing.walk_recovery import bridge_gap
from lidar_buildings.core.stages.roof_selection.smooth_patches.plane_votes import plane_votes
from lidar_buildings.core.stages.roof_selection.smooth_patches.wet_roofs import find_wet_roofs
from lidar_buildings.core.stages.roof_selection.surroundings import share_around
from lidar_buildings.core.stages.terrain import RasterConfig
from lidar_buildings.core.surfaces.brightness import brightness_raster
from lidar_buildings.core.surfaces.roof_planes.adjustment import common_point
from lidar_buildings.pipeline.reconstruct import PipelineConfig
from lidar_buildings.pipeline.tile_models import build_models
from lidar_buildings.pipeline.tile_outlines import regularise_outlines
from lidar_buildings.pipeline.tile_rasters import rasterise_tile
from lidar_buildings.pipeline.tile_stages import (
    filter_ground,
    fit_planes,
    label_roof_edges,
    roof_points,
    select_roof_points,
    trace_buildings,
)

_CONFIG = PipelineConfig()
_sample = cache(sample_tile)


def _ground() -> None:
    filter_ground(_sample().tile, _CONFIG.ground_filter)


def _roofs() -> None:
    select_roof_points(_sample().tile, _CONFIG.roof_selection)


def _outlines() -> None:
    labelled = label_roof_edges(roof_points(_sample().tile), _CONFIG.edge_labelling).tile
    trace_buildings(labelled, _CONFIG.segmentation, _CONFIG.boundary_tracing)


def _regularisation() -> None:
    regularise_outlines(_sample().traced, _CONFIG.regularisation)


def _planes() -> None:
    fit_planes(roof_points(_sample().tile), _CONFIG.plane_fitting)
    common_point(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]))


def _models() -> None:
    models = build_models(roof_points(_sample().tile), _sample().outlines, _CONFIG.building_model)
    for solid in models[0].model.solids.values():
        check_solid(solid)


def _rasters() -> None:
    tile = _sample().tile
    rasterise_tile(tile, RasterConfig(), tile.frame)
    spacing = quantised_spacing(tile.points)
    brightness_raster(tile.points, tile.intensity, np.ones(len(tile), dtype=bool), spacing)


def _simulation() -> None:
    from lidar_buildings.simulation import simulate_tile  # which no run has a use for

    simulate_tile("single_house", density=0.1)


def _rare() -> None:
    """Call what a small tile has no need of."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(40.0), np.arange(40.0)))
    pool = (abs(x - 20.0) > 4.0) | (abs(y - 20.0) > 4.0)
    roof = np.column_stack([x, y, np.full(len(x), 3.0)])[pool]
    everywhere = np.ones(len(roof), dtype=bool)
    find_wet_roofs(roof, roof[:, 2], everywhere, ~everywhere, 1.0, _CONFIG.roof_selection)
    plane_votes(roof, 0.1)
    columns = by_column(roof, 1.0)
    share_around(columns, *np.ones((2, len(roof)), dtype=bool), 1.0)
    grid = build_point_grid(roof, ScanPattern(0.0, 1.0, 1.0), 2.0)
    times = np.arange(2)
    place_points(Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)).at, times[:0], times, roof[:2])
    bridge_gap(grid, np.ones(len(grid.x)), np.array([0]), np.array([1, 2]), 2.0)


#: What every run needs, and all that is compiled; the longest first.
OF_RUNS = (_outlines, _models, _ground, _regularisation, _planes, _roofs, _rasters)
CALLS = (*OF_RUNS, _simulation, _rare)
