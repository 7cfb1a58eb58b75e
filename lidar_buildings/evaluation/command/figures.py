"""The figures of each kind of score, from files."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.stage_table import STAGES
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.solids.validity import check_solid
from lidar_buildings.evaluation.command.score import BUILDING, ScoreOptions
from lidar_buildings.evaluation.readers.city_model import CityBuilding, holds_city_model, read_city_model
from lidar_buildings.evaluation.readers.labelled_points import (
    EDGES,
    LabelledPoints,
    PlaneLabels,
    has_clouds,
    read_label_pairs,
    read_labels,
    read_plane_labels,
    read_roof_points,
)
from lidar_buildings.evaluation.readers.metric_polygons import MetricPolygons, read_metric_polygons
from lidar_buildings.evaluation.scores.cells import (
    REFERENCE_GROUND,
    CellSet,
    cells_of_points,
    cells_of_polygons,
    confusion_of,
    mean,
    percentile,
    ratio,
    score_buildings,
    score_ground,
)
from lidar_buildings.evaluation.scores.corners import score_corners, score_directions
from lidar_buildings.evaluation.scores.edges import (
    NO_ROOF,
    EdgeScore,
    alpha_of_spacing,
    fewest_points,
    reference_edges,
    roof_rows,
    roofs_of_points,
    roofs_of_polygons,
    score_edges,
    score_edges_per_roof,
    split_at_steps,
)
from lidar_buildings.evaluation.scores.models import (
    WITHIN,
    ModelScore,
    same_roof_type,
    score_model_points,
    score_models,
)
from lidar_buildings.evaluation.scores.outlines import (
    MIN_INSIDE,
    MIN_IOU,
    cut_to,
    limits_of,
    merge_touching,
    score_adjustment,
    score_coverage,
    score_outlines,
    valid_polygons,
    within,
)
from lidar_buildings.evaluation.scores.planes import PlaneScore, planes_of_colours, score_planes
from lidar_buildings.evaluation.scores.wireframe import Solids


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


#: Figures that are given for each cloud, too.
PER_CLOUD = ("precision", "recall", "f1", "weighted_coverage")


def plane_figures(result: Path, reference: Path, options: ScoreOptions) -> dict[str, Any]:
    """Compare planes of all clouds together, and cloud by cloud: a cloud may be a roof."""
    clouds = [_labels(cloud, options) for cloud in read_plane_labels(result, reference)]
    scores = [score_planes(mine, theirs) for _, mine, theirs in clouds]
    together = score_planes(
        _joined([mine for _, mine, _ in clouds]), _joined([theirs for _, _, theirs in clouds])
    )
    return {
        "n_points": together.n_points,
        "n_planes_result": together.n_result,
        "n_planes_reference": together.n_reference,
        "n_planes_found": together.n_found,
        **{name: getattr(together, name) for name in (*PER_CLOUD, "coverage")},
        "n_clouds": len(clouds),
        **{f"mean_{name}": _mean(scores, name) for name in PER_CLOUD},
        "clouds": [name for name, _, _ in clouds],
        **{f"{name}_per_cloud": [getattr(score, name) for score in scores] for name in PER_CLOUD},
    }


def _labels(cloud: PlaneLabels, options: ScoreOptions) -> tuple[str, NDArray[np.int64], NDArray[np.int64]]:
    """Return a cloud's name and the planes of both sides within the area of interest, numbered from 1."""
    check_same_system(cloud.crs, "", options.area)
    inside = is_inside(cloud.points, options.area)
    theirs = planes_of_colours(cloud.points, cloud.reference) if cloud.by_colour else cloud.reference
    return cloud.name, _numbered(cloud.result[inside]), _numbered(theirs[inside])


def _numbered(labels: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number planes from 1 on; what is none stays as it is."""
    number = np.searchsorted(np.unique(labels[labels > 0]), labels) + 1
    return np.where(labels > 0, number, labels)


def _joined(parts: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Join the labels of clouds; planes of different clouds are different ones."""
    starts = np.cumsum([0] + [int(part.max(initial=0)) for part in parts])
    shifted = [np.where(part > 0, part + start, part) for part, start in zip(parts, starts[:-1], strict=True)]
    return np.concatenate([np.empty(0, dtype=np.int64), *shifted])


def _mean(scores: list[PlaneScore], name: str) -> float:
    values = np.array([getattr(score, name) for score in scores], dtype=np.float64)
    return mean(values[np.isfinite(values)])


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


#: The levels whose shares are told.
LEVELS = ("2.2", "1.3", "1.2")


def model_figures(result: Path, reference: Path, options: ScoreOptions) -> dict[str, Any]:
    """Compare building models with reference models, or with the points of a cloud's roofs."""
    mine = read_city_model(result)
    if has_clouds(reference) and not holds_city_model(reference):
        points, crs = read_roof_points(reference, options.reference_classes or BUILDING)
        check_same_system(mine.crs, crs, options.area)
        points = points[is_inside(points, options.area)]
        return {
            **_own_figures(mine.buildings, options.lod),
            **_point_figures(mine.buildings, points, options),
        }
    theirs = read_city_model(reference)
    check_same_system(mine.crs, theirs.crs, options.area)
    return {
        **_own_figures(mine.buildings, options.lod),
        **_reference_figures(mine.buildings, theirs.buildings, options),
    }


def _own_figures(buildings: Sequence[CityBuilding], lod: str) -> dict[str, Any]:
    """Return the share of buildings per level of detail, and of valid solids."""
    levels = Counter(building.finest(lod)[0] for building in buildings)
    # Far from the origin of coordinates planes and areas would lose their last digits.
    valid = [
        not check_solid(_near_origin(solid))
        for building in buildings
        for parts in building.solids.values()
        for solid in parts
    ]
    return {
        "lod": lod,
        "n_models": len(buildings),
        **{f"lod_{level.replace('.', '')}_share": ratio(levels[level], len(buildings)) for level in LEVELS},
        "n_solids": len(valid),
        "valid_share": ratio(sum(valid), len(valid)),
        "n_vertices": sum(len(s.vertices) for b in buildings for s in b.finest(lod)[1]),
    }


def _reference_figures(
    mine: Sequence[CityBuilding], theirs: Sequence[CityBuilding], options: ScoreOptions
) -> dict[str, Any]:
    area = None if options.area is None else options.area.polygons
    sides = [building.finest(options.lod)[1] for building in mine], [_finest(building) for building in theirs]
    score = score_models(*sides, tolerance=options.corner_tolerance, area=area)
    ratios = score.volume_ratio[np.isfinite(score.volume_ratio)]
    rmse = score.rmse[np.isfinite(score.rmse)]
    return {
        "n_models_result": score.n_result,
        "n_models_reference": score.n_reference,
        "n_matched": score.n_matched,
        **{f"height_{name}": value for name, value in asdict(score.heights).items()},
        "building_rmse_median": percentile(rmse, 50),
        "building_rmse_95": percentile(rmse, 95),
        "volume_ratio": mean(ratios),
        "volume_error_median": percentile(np.abs(ratios - 1), 50),
        "volume_error_largest": percentile(np.abs(ratios - 1), 100),
        **{f"ridge_{name}": value for name, value in asdict(score.ridges).items()},
        "roof_tolerance": options.corner_tolerance,
        **{f"roof_{name}": value for name, value in asdict(score.wireframe).items()},
        **{f"solid_{name}": value for name, value in asdict(score.counts).items()},
        "same_roof_type": _same_roof_types(mine, theirs, score),
        "partner_per_reference": score.partner.tolist(),
        "rmse_per_reference": score.rmse.tolist(),
        "volume_ratio_per_reference": score.volume_ratio.tolist(),
    }


def _point_figures(
    buildings: Sequence[CityBuilding], points: NDArray[np.float64], options: ScoreOptions
) -> dict[str, Any]:
    figures = asdict(score_model_points([building.finest(options.lod)[1] for building in buildings], points))
    within = dict(zip(WITHIN, figures.pop("within"), strict=True))
    per_building = figures.pop("rmse_per_building").tolist()
    names = {"n_points": "n_roof_points", "n_buildings": "n_buildings_with_points"}
    return {
        **{names.get(name, f"point_{name}"): value for name, value in figures.items()},
        **{f"point_within_{limit * 100:.0f}_cm": share for limit, share in within.items()},
        "name_per_building": [building.name for building in buildings],
        "rmse_per_building": per_building,
    }


def _finest(building: CityBuilding) -> Solids:
    return building.finest(max(building.solids, default=""))[1]


def _same_roof_types(
    mine: Sequence[CityBuilding], theirs: Sequence[CityBuilding], score: ModelScore
) -> float:
    """Return the share of matched buildings of the same roof type, of those where both sides state it."""
    pairs = [(mine[k], theirs[row]) for row, k in enumerate(score.partner.tolist()) if k >= 0]
    types = [(one.attributes.get("roof_type"), other.attributes) for one, other in pairs]
    same = [same_roof_type(found, true) for found, true in types if found and true.get("roof_type")]
    return ratio(sum(same), len(same))


def _near_origin(solid: Solid) -> Solid:
    """Return a solid moved by whole metres to the origin."""
    shift = np.floor(solid.vertices.min(axis=0, initial=np.inf)) if len(solid.vertices) else np.zeros(3)
    # Back on the grid that it was read from.
    return Solid(np.round(solid.vertices - shift, 6), solid.faces, solid.semantics)


def is_inside(points: NDArray[np.float64], area: MetricPolygons | None) -> NDArray[np.bool_]:
    """Whether each point lies within the area of interest."""
    return within(points, None if area is None else shapely.union_all(area.polygons))


def check_same_system(result: str, reference: str, area: MetricPolygons | None) -> None:
    """Refuse sides in different reference systems; one that does not say its own is trusted."""
    named = [crs for crs in (result, reference, "" if area is None else area.crs) if crs.startswith("EPSG:")]
    if len(set(named)) > 1:
        raise InputError(
            f"the result, the reference and the area of interest are in {', '.join(dict.fromkeys(named))}: "
            "transform them to one reference system"
        )


FIGURES: dict[str, Callable[[Path, Path, ScoreOptions], dict[str, Any]]] = {
    "ground": ground_figures,
    "buildings": building_figures,
    "outlines": outline_figures,
    "edges": edge_figures,
    "planes": plane_figures,
    "models": model_figures,
}
