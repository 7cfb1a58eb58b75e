"""Each kind of score: read both sides, bring them together, compare them in the core."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.evaluation.command.edges import edge_figures
from lidar_buildings.evaluation.command.models import model_figures
from lidar_buildings.evaluation.command.options import BUILDING, ScoreOptions, check_same_system, is_inside
from lidar_buildings.evaluation.command.outlines import outline_figures
from lidar_buildings.evaluation.command.planes import plane_figures
from lidar_buildings.evaluation.readers.labelled_points import (
    LabelledPoints,
    has_clouds,
    read_label_pairs,
    read_labels,
)
from lidar_buildings.evaluation.readers.metric_polygons import MetricPolygons, read_metric_polygons
from lidar_buildings.evaluation.scores.cells import (
    CellSet,
    cells_of_points,
    cells_of_polygons,
    score_buildings,
)
from lidar_buildings.evaluation.scores.ground import REFERENCE_GROUND, score_ground
from lidar_buildings.evaluation.scores.statistics import confusion_of


def ground_figures(result: Path, reference: Path, options: ScoreOptions) -> dict[str, Any]:
    """Compare ground point by point."""
    _, labels = _inside(read_label_pairs(result, reference), options.area)
    return asdict(score_ground(*labels, reference_ground=options.reference_classes or REFERENCE_GROUND))


def building_figures(result: Path, reference: Path, options: ScoreOptions) -> dict[str, Any]:
    """Compare building cells; and points, too, where both sides are clouds."""
    if has_clouds(result) and has_clouds(reference):
        return _building_figures_of_points(result, reference, options)
    sides = [
        _read_side(result, BUILDING, options, is_reference=False),
        _read_side(reference, options.reference_classes or BUILDING, options, is_reference=True),
    ]
    check_same_system(sides[0][1], sides[1][1], options.area)
    return _cell_figures(sides[0][0], sides[1][0], options)


FIGURES: dict[str, Callable[[Path, Path, ScoreOptions], dict[str, Any]]] = {
    "ground": ground_figures,
    "buildings": building_figures,
    "outlines": outline_figures,
    "edges": edge_figures,
    "planes": plane_figures,
    "models": model_figures,
}


def _building_figures_of_points(result: Path, reference: Path, options: ScoreOptions) -> dict[str, Any]:
    cloud = read_label_pairs(result, reference)
    wanted = BUILDING, options.reference_classes or BUILDING
    masks = [np.isin(labels, list(classes)) for labels, classes in zip(cloud.labels, wanted, strict=True)]
    cells = [cells_of_points(cloud.points, mask, options.cell, reach=options.fill) for mask in masks]
    check_same_system(cloud.crs, "", options.area)
    inside = is_inside(cloud.points, options.area)
    points = confusion_of(masks[0][inside], masks[1][inside])
    return {
        **_cell_figures(cells[0], cells[1], options),
        "n_points": points.total,
        "point_recall": points.recall,
        "point_precision": points.precision,
        "point_f1": points.f1,
        "point_iou": points.iou,
    }


def _cell_figures(result: CellSet, reference: CellSet, options: ScoreOptions) -> dict[str, Any]:
    area = None if options.area is None else options.area.polygons
    return asdict(score_buildings(result, reference, cell=options.cell, area=area))


def _read_side(
    path: Path, classes: Collection[int], options: ScoreOptions, *, is_reference: bool
) -> tuple[CellSet, str]:
    """Return the building cells of a cloud or of polygons, and the name of their reference system."""
    if not has_clouds(path):
        layer = read_metric_polygons(path)
        return cells_of_polygons(layer.polygons, options.cell), layer.crs
    cloud = read_labels(path, prefer_truth=is_reference)
    is_building = np.isin(cloud.labels[0], list(classes))
    return cells_of_points(cloud.points, is_building, options.cell, reach=options.fill), cloud.crs


def _inside(
    cloud: LabelledPoints, area: MetricPolygons | None
) -> tuple[NDArray[np.float64], tuple[NDArray[np.uint8], ...]]:
    check_same_system(cloud.crs, "", area)
    inside = is_inside(cloud.points, area)
    return cloud.points[inside], tuple(labels[inside] for labels in cloud.labels)
