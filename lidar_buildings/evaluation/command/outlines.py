"""Outlines against a reference: as objects, as area, by boundaries, corners and angles, and their own σ."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.evaluation.command.options import ScoreOptions, check_same_system
from lidar_buildings.evaluation.readers.metric_polygons import MetricPolygons, read_metric_polygons
from lidar_buildings.evaluation.scores.blocks import merge_touching
from lidar_buildings.evaluation.scores.corners import score_corners
from lidar_buildings.evaluation.scores.directions import score_directions
from lidar_buildings.evaluation.scores.outlines import (
    MIN_IOU,
    score_adjustment,
    score_coverage,
    score_outlines,
)
from lidar_buildings.evaluation.scores.polygons import MIN_INSIDE, cut_to, limits_of, valid_polygons

#: Attributes of a run's outlines that Table 1 is made of.
ADJUSTED = ("point_spacing", "outline_sigma", "outline_max_offset")


def outline_figures(result: Path, reference: Path, options: ScoreOptions) -> dict[str, Any]:
    """Compare outlines as objects, as area, along their boundaries, and by their corners and angles."""
    sides = [read_metric_polygons(path) for path in (result, reference)]
    check_same_system(sides[0].crs, sides[1].crs, options.area)
    area = None if options.area is None else options.area.polygons
    mine, theirs = (side.polygons for side in sides)
    coverage = asdict(score_coverage(mine, theirs, area=area))
    coverage["covered_per_building"] = coverage.pop("covered").tolist()
    figures = {**coverage, **_adjustment_figures(sides[0], area)}
    if options.merge_touching:
        blocks = merge_touching(theirs)
        figures["block_per_building"] = blocks.block.tolist()
        mine, theirs = merge_touching(mine).polygons, blocks.polygons
    return {**_object_figures(mine, theirs, area, options.corner_tolerance), **figures}


def _object_figures(
    mine: NDArray[Any], theirs: NDArray[Any], area: NDArray[Any] | None, corner_tolerance: float
) -> dict[str, Any]:
    """Compare outlines, or blocks of them, one to one."""
    score = score_outlines(mine, theirs, area=area)
    figures = asdict(score)
    distances = {
        f"{name}_{figure}": value
        for name in ("boundary", "boundary_of_unions")
        for figure, value in figures.pop(name).items()
    }
    per_outline = {f"{name}_per_reference": figures.pop(name).tolist() for name in ("partner", "iou")}
    corners = asdict(score_corners(mine, theirs, tolerance=corner_tolerance, area=area))
    found = np.flatnonzero(score.iou >= MIN_IOU)
    pairs = valid_polygons(mine)[score.partner[found]], valid_polygons(theirs)[found]
    angles = asdict(score_directions(*pairs, limits=limits_of(area)))
    return {
        **figures,
        **distances,
        "corner_tolerance": corner_tolerance,
        **{f"corner_{name}": value for name, value in corners.items()},
        **{f"angle_{name}": value for name, value in angles.items()},
        **per_outline,
    }


def _adjustment_figures(result: MetricPolygons, area: NDArray[Any] | None) -> dict[str, Any]:
    """Average σ and largest offset of the outlines inside the area, where the result says them."""
    if not all(name in result.attributes for name in ADJUSTED):
        return {}
    counted = cut_to(valid_polygons(result.polygons), limits_of(area))[1] >= MIN_INSIDE
    lengths = [result.attributes[name][counted].astype(np.float64) * result.unit for name in ADJUSTED]
    return {f"adjusted_{name}": value for name, value in asdict(score_adjustment(*lengths)).items()}
