"""The score of edges: a result's edge labels against the alpha shapes of a reference's roofs."""

from __future__ import annotations

import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.stage_table import STAGES
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.evaluation.command.options import BUILDING, ScoreOptions, check_same_system, is_inside
from lidar_buildings.evaluation.readers.labelled_points import (
    EDGES,
    LabelledPoints,
    has_clouds,
    read_label_pairs,
    read_labels,
)
from lidar_buildings.evaluation.readers.metric_polygons import read_metric_polygons
from lidar_buildings.evaluation.scores.edges import (
    EdgeScore,
    alpha_of_spacing,
    reference_edges,
    score_edges,
    score_edges_per_roof,
)
from lidar_buildings.evaluation.scores.roofs import (
    NO_ROOF,
    fewest_points,
    roof_rows,
    roofs_of_points,
    roofs_of_polygons,
    split_at_steps,
)


def edge_figures(result: Path, reference: Path, options: ScoreOptions) -> dict[str, Any]:
    """
    Compare edge labels with the alpha shapes of the reference's roofs.

    A roof consists of the points that both sides have on roofs (polygons: the result's roof points within):
    labels are judged by the points they were made of. Alpha shapes go beyond the area of interest.
    """
    _check_labels_were_made(result)
    cloud, roof, n_roofs = _roofs_of_reference(result, reference, options)
    labelled, inside = _labelled(cloud), is_inside(cloud.points, options.area)
    rows = np.flatnonzero((roof != NO_ROOF) & labelled)
    points, spacing = cloud.points[rows], measure_spacing(cloud.points[rows])
    alpha, number = options.alpha or alpha_of_spacing(spacing), roof[rows]
    if options.split_steps:
        gap = 2.0 * alpha_of_spacing(spacing)
        number = split_at_steps(points, number, gap, min_points=fewest_points(spacing))
        n_roofs = int(number.max(initial=NO_ROOF)) + 1
    truth = reference_edges(points, number, alpha)[inside[rows]]
    kept = rows[inside[rows]]
    edge = cloud.labels[1][kept] == 1
    return {
        "alpha": alpha,
        "spacing": spacing,
        "n_unlabelled": int(np.count_nonzero((roof != NO_ROOF) & inside & ~labelled)),
        **asdict(score_edges(edge, truth)),
        **_figures_per_roof(cloud.points[kept], edge, truth, number[inside[rows]], n_roofs),
    }


def _check_labels_were_made(result: Path) -> None:
    """Refuse the output folder of a run that ended before the edges."""
    try:
        until = json.loads((result / "run.json").read_text())["until"]
    except (OSError, ValueError, KeyError, TypeError):
        return
    if until in STAGES and STAGES.index(until) < STAGES.index("edge_labelling"):
        raise InputError(f"{result}: the run ended after {until}: run it again with --until edge_labelling")


def _labelled(cloud: LabelledPoints) -> NDArray[np.bool_]:
    """Tell which points the result has on roofs: façades are of class 6, too, but have no label."""
    return np.isin(cloud.labels[0], BUILDING) & (cloud.labels[2] == 0)


def _roofs_of_reference(
    result: Path, reference: Path, options: ScoreOptions
) -> tuple[LabelledPoints, NDArray[np.int64], int]:
    """Return the result's points and labels, each point's roof in the reference, and the number of roofs."""
    if not has_clouds(reference):
        cloud = read_labels(result, prefer_truth=False, beside=EDGES)
        layer = read_metric_polygons(reference)
        check_same_system(cloud.crs, layer.crs, options.area)
        return cloud, roofs_of_polygons(cloud.points, layer.polygons), len(layer.polygons)
    cloud = read_label_pairs(result, reference, beside=EDGES)
    check_same_system(cloud.crs, "", options.area)
    rows = np.flatnonzero(np.isin(cloud.labels[3], list(options.reference_classes or BUILDING)))
    points, spacing = cloud.points[rows], measure_spacing(cloud.points[rows])
    roof = np.full(len(cloud.points), NO_ROOF, dtype=np.int64)
    roof[rows] = roofs_of_points(points, 2.0 * alpha_of_spacing(spacing), min_points=fewest_points(spacing))
    return cloud, roof, int(roof.max(initial=NO_ROOF)) + 1


def _figures_per_roof(
    points: NDArray[np.float64],
    edge: NDArray[np.bool_],
    truth: NDArray[np.bool_],
    roof: NDArray[np.int64],
    n_roofs: int,
) -> dict[str, Any]:
    scores = [asdict(score) for score in score_edges_per_roof(edge, truth, roof, n_roofs)]
    return {
        "n_roofs": sum(score["n_points"] > 0 for score in scores),
        "middle_per_roof": _middles(points, roof, n_roofs),
        **{f"{field.name}_per_roof": [score[field.name] for score in scores] for field in fields(EdgeScore)},
    }


def _middles(points: NDArray[np.float64], roof: NDArray[np.int64], n_roofs: int) -> list[list[float] | None]:
    """Return the mean position in plan of each roof's points [m], None for a roof without."""
    middles: list[list[float] | None] = [None] * n_roofs
    for rows in roof_rows(roof):
        middles[roof[rows[0]]] = points[rows, :2].mean(axis=0).tolist()
    return middles
