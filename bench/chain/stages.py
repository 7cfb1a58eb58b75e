"""
Each stage alone, on one core, in a process of its own: processor seconds once all is loaded and compiled.

    python -m bench.chain.stages REPEATS FILE ...                  stages of the cloud, and its models
    python -m bench.chain.stages REPEATS --village                 the same of the virtual village
    python -m bench.chain.stages REPEATS --footprints MAP FILE ... with given outlines

prints a line of JSON: the least of the repeats per stage.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.chain.decoding import decode
from bench.common.clouds import read_files
from bench.common.process_tree import cpu_of, tree_of
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.point_spacing import quantised_spacing
from lidar_buildings.core.solids.shell import ROOF_SURFACE
from lidar_buildings.core.stages.footprints.footprints import Footprints
from lidar_buildings.core.stages.roof_selection.selection import last_and_only_returns
from lidar_buildings.core.surfaces.intensity import normalised_intensity, strip_scales
from lidar_buildings.io.vectors.footprints import FootprintSource, read_footprints
from lidar_buildings.pipeline.config import PipelineConfig
from lidar_buildings.pipeline.tile_models import TileModel, build_models
from lidar_buildings.pipeline.tile_outlines import regularise_outlines
from lidar_buildings.pipeline.tile_stages import (
    filter_ground,
    fit_planes,
    label_roof_edges,
    roof_points,
    select_roof_points,
)
from lidar_buildings.pipeline.tile_tracing import trace_buildings, trace_footprints
from lidar_buildings.simulation import simulate_tile

DECODING, TILE = "decoding", "spacing and brightness"
GROUND, ROOFS, EDGES = "ground filter", "roof selection", "edge labelling"
TRACING, OUTLINES = "segmentation and tracing", "regularisation"
PLANES, MODELS = "plane fitting", "models"


def processor_time() -> float:
    """Return what this process and all that it has started have used so far [s]."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + ended.ru_utime + ended.ru_stime + cpu_of(tree_of(os.getpid())[1:])


class Clock:
    """Calls stages and keeps the least time of each, and the wall time beside."""

    def __init__(self) -> None:
        self.cpu: dict[str, float] = {}
        self.wall: dict[str, float] = {}

    def __call__(self, stage: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function for a stage."""
        cpu, wall = processor_time(), time.perf_counter()
        result = function(*arguments)
        for seconds, used in (
            (self.cpu, processor_time() - cpu),
            (self.wall, time.perf_counter() - wall),
        ):
            seconds[stage] = min(used, seconds.get(stage, used))
        return result


def run_stages(
    clock: Clock, tile: PointTile, config: PipelineConfig, footprints: Footprints | None = None
) -> tuple[PointTile, tuple[TileModel, ...]]:
    """
    Take a tile through all stages; return its roof points and models.

    What tiles of a run come with, and stages would measure anew, is measured once.
    """
    tile = clock(TILE, as_of_a_run, tile)
    classified = clock(GROUND, filter_ground, tile, config.ground_filter).tile
    classified = clock(ROOFS, select_roof_points, classified, config.roof_selection)
    roofs = roof_points(classified)
    roofs = clock(EDGES, label_roof_edges, roofs, config.edge_labelling).tile
    if footprints is None:
        found = clock(TRACING, trace_buildings, roofs, config.segmentation, config.boundary_tracing)
        outlines = clock(OUTLINES, regularise_outlines, found.outlines, config.regularisation)
    else:
        given = (footprints, config.footprints, config.edge_labelling)
        found = clock("footprints", trace_footprints, classified, roofs, *given)
        outlines = found.outlines
    planes = clock(PLANES, fit_planes, found.tile, config.plane_fitting)
    return roofs, clock(MODELS, build_models, planes, outlines, config.building_model)


def measure(
    tile: PointTile, repeats: int, files: Sequence[str] = (), footprints: Footprints | None = None
) -> dict[str, Any]:
    """Run the chain once to load everything and then as often as asked for; files are decoded in between."""
    config = PipelineConfig()
    roofs, models = run_stages(Clock(), tile, config, footprints)
    clock = Clock()
    for _ in range(repeats):
        if files:
            clock(DECODING, decode, files)
        run_stages(clock, tile, config, footprints)
    return {
        "points": len(tile),
        "roof_points": len(roofs),
        "buildings": len(models),
        "faces": sum(n_roof_faces(one) for one in models),
        "cpu": clock.cpu,
        "wall": clock.wall,
    }


def as_of_a_run(tile: PointTile) -> PointTile:
    """Return a tile with its spacing and normalised intensities, which whoever makes tiles measures."""
    columns: dict[str, Any] = {}
    if tile.point_spacing is None:
        columns["point_spacing"] = quantised_spacing(tile.points)
    if tile.normalised_intensity is None and tile.intensity is not None:
        intensity = tile.intensity.astype(np.float32)
        strip = np.zeros(len(tile), np.int64) if tile.point_source_id is None else tile.point_source_id
        _, is_only = last_and_only_returns(tile.points, tile.return_number, tile.number_of_returns)
        scales = strip_scales(intensity, strip, is_only)
        columns["normalised_intensity"] = normalised_intensity(intensity, strip, scales)
    return tile.with_columns(**columns)


def n_roof_faces(one: TileModel) -> int:
    """Count the roof faces of a building's finest solid."""
    finest = max(one.model.solids.items(), default=("", None))[1]
    return 0 if finest is None else finest.semantics.count(ROOF_SURFACE)


def main(arguments: Sequence[str]) -> None:
    """Measure what the arguments name."""
    repeats, *rest = arguments
    if rest == ["--village"]:
        figures = measure(simulate_tile("village")[0], int(repeats))
    elif rest[0] == "--footprints":
        tile, frame = read_files([Path(file) for file in rest[2:]])
        given = read_footprints(FootprintSource(Path(rest[1])), frame).footprints
        figures = measure(tile, int(repeats), rest[2:], given)
    else:
        figures = measure(read_files([Path(file) for file in rest])[0], int(repeats), rest)
    print(json.dumps(figures))


if __name__ == "__main__":
    main(sys.argv[1:])
