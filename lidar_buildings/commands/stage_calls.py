"""One call of each stage, on a stored tile so small that what takes time is the compiling."""

from __future__ import annotations

import gc
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import View
from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.parallel import share_cores
from lidar_buildings.core.neighbours.point_spacing import quantised_spacing
from lidar_buildings.core.neighbours.scan_pattern import ScanPattern, as_pulses, measure_scan_patterns
from lidar_buildings.core.neighbours.seen_voxels import SeenVoxels
from lidar_buildings.core.scans.motion import place_points
from lidar_buildings.core.scans.trajectory import Pose
from lidar_buildings.core.solids.validity import check_solid
from lidar_buildings.core.stages.boundary_tracing.point_grid import build_point_grid
from lidar_buildings.core.stages.boundary_tracing.walk import bridge_gap
from lidar_buildings.core.stages.roof_selection.roof_patches import plane_votes
from lidar_buildings.core.stages.roof_selection.wet_roofs import find_wet_roofs
from lidar_buildings.core.stages.terrain.config import RasterConfig
from lidar_buildings.core.stages.terrain.interpolation import KRIGING
from lidar_buildings.core.stages.terrain.relief import relief
from lidar_buildings.core.surfaces.intensity import brightness_raster
from lidar_buildings.core.surfaces.known_ground import KnownGround
from lidar_buildings.core.surfaces.plane_adjustment import common_point
from lidar_buildings.pipeline.config import PipelineConfig
from lidar_buildings.pipeline.tile_facades import find_tile_facades, street_points
from lidar_buildings.pipeline.tile_models import build_models
from lidar_buildings.pipeline.tile_outlines import regularise_outlines
from lidar_buildings.pipeline.tile_stages import (
    filter_ground,
    fit_planes,
    label_roof_edges,
    rasterise_tile,
    roof_points,
    select_roof_points,
)
from lidar_buildings.pipeline.tile_tracing import trace_buildings

_CONFIG = PipelineConfig()
#: Written by ``python -m bench.common.sample_tile``.
SAMPLE = Path(__file__).with_name("sample_tile.npz")


def _ground() -> None:
    tile = sample_tile().tile
    filter_ground(tile, _CONFIG.ground_filter)
    street = np.full(len(tile), View.STREET, dtype=np.uint8)
    filter_ground(tile.with_columns(view=street), _CONFIG.ground_filter)


def _roofs() -> None:
    select_roof_points(sample_tile().tile, _CONFIG.roof_selection)


def _outlines() -> None:
    labelled = label_roof_edges(roof_points(sample_tile().tile), _CONFIG.edge_labelling).tile
    trace_buildings(labelled, _CONFIG.segmentation, _CONFIG.boundary_tracing)


def _regularisation() -> None:
    regularise_outlines(sample_tile().traced, _CONFIG.regularisation)


def _planes() -> None:
    fit_planes(roof_points(sample_tile().tile), _CONFIG.plane_fitting)
    common_point(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]))


def _models() -> None:
    models = build_models(roof_points(sample_tile().tile), sample_tile().outlines, _CONFIG.building_model)
    for solid in models[0].model.solids.values():
        check_solid(solid)


def _rasters() -> None:
    tile = sample_tile().tile
    rasterise_tile(tile, RasterConfig(), tile.frame)
    relief(np.eye(3), 1.0)
    spacing = quantised_spacing(tile.points)
    brightness_raster(tile.points, tile.intensity, np.ones(len(tile), dtype=bool), spacing)


def _simulation() -> None:
    from lidar_buildings.simulation import simulate_tile  # which no run has a use for

    simulate_tile("single_house", density=0.1)


def _rare() -> None:
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(40.0), np.arange(40.0)))
    pool = (abs(x - 20.0) > 4.0) | (abs(y - 20.0) > 4.0)
    roof = np.column_stack([x, y, np.full(len(x), 3.0)])[pool]
    everywhere = np.ones(len(roof), dtype=bool)
    find_wet_roofs(roof, roof[:, 2], everywhere, ~everywhere, 1.0, _CONFIG.roof_selection)
    plane_votes(roof, 0.1)
    bare, one_group = as_pulses(roof, None, None), np.zeros(len(roof), dtype=np.int64)
    measure_scan_patterns(bare, one_group, 1, 1.0, min_ratio=1.0)
    grid = build_point_grid(roof, ScanPattern(0.0, 1.0, 1.0), 2.0)
    times = np.arange(2)
    place_points(Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)).at, times[:0], times, roof[:2])
    SeenVoxels().are_new(roof, 1.0)
    tile = sample_tile().tile
    rasterise_tile(tile, RasterConfig(dtm_interpolation=KRIGING), tile.frame)
    street = tile.with_columns(view=np.full(len(tile), View.STREET))
    find_tile_facades(street_points(street), (), _CONFIG.facades)
    KnownGround.at(roof).elevation(roof[:2, :2])
    bridge_gap(grid, np.ones(len(grid.x)), np.array([0]), np.array([1, 2]), 2.0)


class _SampleTile(NamedTuple):
    tile: PointTile  #: with the columns of all stages
    #: Before and after regularisation.
    traced: tuple[BuildingOutline, ...]
    outlines: tuple[BuildingOutline, ...]


@cache
def sample_tile() -> _SampleTile:
    """Read the tile."""
    with np.load(SAMPLE) as stored:
        columns = {name: stored[name] for name in stored.files}
    traced, outlines = (_stored_outlines(columns.pop(f"{name}_rings")) for name in ("traced", "outlines"))
    n = len(columns["points"])
    spacing = float(columns.pop("point_spacing"))
    tile = PointTile(**columns, point_spacing=spacing, source=np.zeros(n), index=np.arange(n))
    return _SampleTile(tile, traced, outlines)


def _stored_outlines(rows: NDArray[np.float64]) -> tuple[BuildingOutline, ...]:
    outlines = []
    for building in np.unique(rows[:, 0]):
        own = rows[rows[:, 0] == building]
        outer, *holes = (own[own[:, 1] == number, 2:] for number in np.unique(own[:, 1]))
        outlines.append(BuildingOutline(int(building), Outline(outer, tuple(holes))))
    return tuple(outlines)


#: What every run needs, and all that is compiled; the longest first, but what models call, too, before these.
OF_RUNS = (_outlines, _models, _regularisation, _ground, _planes, _roofs, _rasters)
CALLS = (*OF_RUNS, _simulation, _rare)


@cache
def load_stages() -> None:
    """Load what works on tiles, compiled code by a call of each stage, once; leave no thread behind."""
    gc.disable()
    share_cores(lambda: False)
    for call in OF_RUNS:
        call()
    share_cores(lambda: True)
    gc.freeze()  # it stays to the end: looked through for garbage it would take a twentieth of a run
    gc.enable()
