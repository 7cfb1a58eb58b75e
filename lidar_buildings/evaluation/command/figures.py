"""The figures of each kind of score, from files; `doc/scores.md` says what they are."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.stage_table import STAGES
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.solids.validity import check_solid
from lidar_buildings.evaluation.command.score import BUILDING, LODS, ScoreOptions
from lidar_buildings.evaluation.readers import labelled_points
from lidar_buildings.evaluation.readers.city_model import (
    CityBuilding,
    CityModel,
    holds_city_model,
    read_city_model,
)
from lidar_buildings.evaluation.readers.labelled_points import EDGES, LabelledPoints, has_clouds, read_labels
from lidar_buildings.evaluation.readers.metric_polygons import MetricPolygons, read_metric_polygons
from lidar_buildings.evaluation.readers.terrain import read_dtm
from lidar_buildings.evaluation.readers.true_lengths import scale_of, scaled
from lidar_buildings.evaluation.scores import cells, control, edges, models, outlines, planes
from lidar_buildings.evaluation.scores.cells import CellSet, Confusion, Figures, confusion_of, named, ratio

#: Classes of a control cloud that are neither walls nor roofs: ground, vegetation, noise, water.
_NO_BUILDING = (2, 3, 4, 5, 7, 9, 11, 18)

_Side = TypeVar("_Side", LabelledPoints, MetricPolygons, CityModel)


def _members(agreement: Confusion, *names: str) -> Figures:
    return {name: getattr(agreement, name) for name in names}


def ground_figures(result: Path, reference: Path, options: ScoreOptions) -> Figures:
    """Compare ground point by point."""
    cloud = labelled_points.read_label_pairs(result, reference)
    _check_same_system(cloud.crs, "", options.area)
    inside = _is_inside(cloud.points, options.area)
    mine, theirs = (labels[inside] for labels in cloud.labels)
    ground = options.reference_classes or cells.REFERENCE_GROUND
    found = cells.score_ground(mine, theirs, reference_ground=ground)
    counts = {"n_points": found.total, "n_ground": found.hits + found.misses}
    return counts | _members(found, "type_1_error", "type_2_error", "total_error", "kappa")


def building_figures(result: Path, reference: Path, options: ScoreOptions) -> Figures:
    """Compare building cells; and points, too, where both sides are clouds."""
    wanted = BUILDING, options.reference_classes or BUILDING
    if not (has_clouds(result) and has_clouds(reference)):
        mine, reference_side = (
            _building_side(path, classes, is_reference=path is reference)
            for path, classes in zip((result, reference), wanted, strict=True)
        )
        _check_same_system(mine.crs, reference_side.crs, options.area)
        scale, options = scale_of(mine), _true(mine, options)[1]
        sides = (_cells_of(scaled(one, scale), options) for one in (mine, reference_side))
        return _cell_figures(*sides, options)
    cloud, options = _true(labelled_points.read_label_pairs(result, reference), options)
    masks = [np.isin(labels, list(classes)) for labels, classes in zip(cloud.labels, wanted, strict=True)]
    mine, theirs = (cells.cells_of_points(cloud.points, mask, options.cell) for mask in masks)
    _check_same_system(cloud.crs, "", options.area)
    inside = _is_inside(cloud.points, options.area)
    points = confusion_of(masks[0][inside], masks[1][inside])
    figures = _cell_figures(mine, theirs, options) | {"n_points": points.total}
    return figures | named("point", _members(points, "recall", "precision", "f1", "iou"))


def _cell_figures(result: CellSet, reference: CellSet, options: ScoreOptions) -> Figures:
    area = None if options.area is None else options.area.polygons
    found = cells.score_buildings(result, reference, cell=options.cell, area=area)
    return {"cell": options.cell} | _members(found, "recall", "precision", "iou")


def _building_side(
    path: Path, classes: Collection[int], *, is_reference: bool
) -> MetricPolygons | LabelledPoints:
    """Return polygons, or points labelled 1 where they are of buildings."""
    if not has_clouds(path):
        return read_metric_polygons(path)
    cloud = read_labels(path, prefer_truth=is_reference)
    return replace(cloud, labels=(np.isin(cloud.labels[0], list(classes)).view(np.uint8),))


def _cells_of(side: MetricPolygons | LabelledPoints, options: ScoreOptions) -> CellSet:
    if isinstance(side, MetricPolygons):
        return cells.cells_of_polygons(side.polygons, options.cell)
    return cells.cells_of_points(side.points, side.labels[0].view(np.bool_), options.cell)


def edge_figures(result: Path, reference: Path, options: ScoreOptions) -> Figures:
    """
    Compare edge labels with the alpha shapes of the reference's roofs.

    A roof consists of the points that both sides have on roofs (polygons: the result's roof points within):
    labels are judged by the points they were made of. Alpha shapes go beyond the area of interest.
    """
    _check_labels_were_made(result)
    cloud, roof, options = _roofs_of_reference(result, reference, options)
    # Façades are of class 6, too, but have no label.
    labelled = np.isin(cloud.labels[0], BUILDING) & (cloud.labels[2] == 0)
    inside = _is_inside(cloud.points, options.area)
    rows = np.flatnonzero((roof != edges.NO_ROOF) & labelled)
    spacing = measure_spacing(cloud.points[rows])
    alpha, kept = edges.alpha_of_spacing(spacing), inside[rows]
    truth = edges.reference_edges(cloud.points[rows], roof[rows], alpha)[kept]
    return {
        "alpha": alpha,
        "spacing": spacing,
        "n_unlabelled": int(np.count_nonzero((roof != edges.NO_ROOF) & inside & ~labelled)),
        "n_roofs": len(np.unique(roof[rows[kept]])),
        **edges.score_edges(cloud.labels[1][rows[kept]] == 1, truth),
    }


def _check_labels_were_made(result: Path) -> None:
    try:
        until = json.loads((result / "run.json").read_text())["until"]
    except (OSError, ValueError, KeyError, TypeError):
        return
    if until in STAGES and STAGES.index(until) < STAGES.index("edge_labelling"):
        raise InputError(f"{result}: the run ended after {until}: run it again with --until edge_labelling")


def _roofs_of_reference(
    result: Path, reference: Path, options: ScoreOptions
) -> tuple[LabelledPoints, NDArray[np.int64], ScoreOptions]:
    """Return the result's points and labels, their roofs in the reference, and options in their scale."""
    if not has_clouds(reference):
        cloud = read_labels(result, prefer_truth=False, beside=EDGES)
        layer = read_metric_polygons(reference)
        _check_same_system(cloud.crs, layer.crs, options.area)
        layer = scaled(layer, scale_of(cloud))
        cloud, options = _true(cloud, options)
        return cloud, edges.roofs_of_polygons(cloud.points, layer.polygons), options
    cloud, options = _true(labelled_points.read_label_pairs(result, reference, beside=EDGES), options)
    _check_same_system(cloud.crs, "", options.area)
    rows = np.flatnonzero(np.isin(cloud.labels[3], list(options.reference_classes or BUILDING)))
    points, spacing = cloud.points[rows], measure_spacing(cloud.points[rows])
    roof = np.full(len(cloud.points), edges.NO_ROOF, dtype=np.int64)
    roof[rows] = edges.roofs_of_points(
        points, 2.0 * edges.alpha_of_spacing(spacing), min_points=edges.fewest_points(spacing)
    )
    return cloud, roof, options


def plane_figures(result: Path, reference: Path, options: ScoreOptions) -> Figures:
    """Compare the planes of all clouds together; planes of different clouds are different ones."""
    sides: tuple[list[NDArray[np.int64]], ...] = ([], [])
    n_planes = [0, 0]
    for cloud in labelled_points.read_plane_labels(result, reference):
        _check_same_system(cloud.crs, "", options.area)
        inside = _is_inside(cloud.points, options.area)
        theirs = (
            planes.planes_of_colours(cloud.points, cloud.reference) if cloud.by_colour else cloud.reference
        )
        for side, plane in enumerate((cloud.result[inside], theirs[inside])):
            numbers = np.unique(plane[plane > 0])
            numbered = np.searchsorted(numbers, plane) + 1 + n_planes[side]
            sides[side].append(np.where(plane > 0, numbered, plane))
            n_planes[side] += len(numbers)
    score = planes.score_planes(*(np.concatenate([*side, np.empty(0, dtype=np.int64)]) for side in sides))
    return {"n_clouds": len(sides[0])} | {name: one for name, one in vars(score).items() if name != "iou"}


def outline_figures(result: Path, reference: Path, options: ScoreOptions) -> Figures:
    """Compare outlines as objects, as area, along their boundaries, and by their corners and angles."""
    sides = [read_metric_polygons(path) for path in (result, reference)]
    _check_same_system(sides[0].crs, sides[1].crs, options.area)
    scale, options = scale_of(sides[0]), _true(sides[0], options)[1]
    sides = [scaled(side, scale) for side in sides]
    area = None if options.area is None else options.area.polygons
    mine, theirs = (side.polygons for side in sides)
    covered = outlines.covered_share(mine, theirs, area=area)
    if options.merge_touching:
        mine, theirs = outlines.merge_touching(mine), outlines.merge_touching(theirs)
    score = outlines.score_outlines(mine, theirs, area=area)
    found = np.flatnonzero(score["iou_per_reference"] >= outlines.MIN_IOU)
    pairs = (
        outlines.valid_polygons(mine)[score["partner_per_reference"][found]],
        outlines.valid_polygons(theirs)[found],
    )
    tolerance = options.corner_tolerance
    return {
        **score,
        "covered_share": covered,
        "corner_tolerance": tolerance,
        **named("corner", outlines.score_corners(mine, theirs, tolerance=tolerance, area=area)),
        **named("angle", outlines.score_directions(*pairs, limits=outlines.limits_of(area))),
    }


def model_figures(result: Path, reference: Path, options: ScoreOptions) -> Figures:
    """Compare building models with reference models, or with the points of a cloud's roofs."""
    mine = read_city_model(result)
    scale = scale_of(mine)
    mine, options = _true(mine, options)
    figures = _own_figures(mine.buildings, options.lod)
    solids = [building.finest(options.lod)[1] for building in mine.buildings]
    if has_clouds(reference) and not holds_city_model(reference):
        points, crs = labelled_points.read_roof_points(reference, options.reference_classes or BUILDING)
        _check_same_system(mine.crs, crs, options.area)
        points = points * (scale, scale, 1.0)
        score = models.score_model_points(solids, points[_is_inside(points, options.area)])
        return {**figures, "n_roof_points": score.pop("n_points"), **named("point", score)}
    theirs = scaled(read_city_model(reference), scale)
    _check_same_system(mine.crs, theirs.crs, options.area)
    area = None if options.area is None else options.area.polygons
    true = [building.finest(max(building.solids, default=""))[1] for building in theirs.buildings]
    tolerance = options.corner_tolerance
    score = models.score_models(solids, true, tolerance=tolerance, area=area)
    partners = score["partner_per_reference"].tolist()
    types = [
        (mine.buildings[k].attributes.get("roof_type"), building.attributes)
        for k, building in zip(partners, theirs.buildings, strict=True)
        if k >= 0
    ]
    same = [models.same_roof_type(found, told) for found, told in types if found and told.get("roof_type")]
    return {**figures, "roof_tolerance": tolerance, **score, "same_roof_type": ratio(sum(same), len(same))}


def _own_figures(buildings: Sequence[CityBuilding], lod: str) -> Figures:
    levels = Counter(building.finest(lod)[0] for building in buildings)
    valid = [
        not check_solid(_near_origin(solid))
        for building in buildings
        for parts in building.solids.values()
        for solid in parts
    ]
    return {
        "lod": lod,
        "n_models": len(buildings),
        **{f"lod_{level.replace('.', '')}_share": ratio(levels[level], len(buildings)) for level in LODS},
        "n_solids": len(valid),
        "valid_share": ratio(sum(valid), len(valid)),
    }


def _near_origin(solid: Solid) -> Solid:
    """Return a solid moved by whole metres to the origin: far from it planes and areas lose digits."""
    shift = np.floor(solid.vertices.min(axis=0, initial=np.inf)) if len(solid.vertices) else np.zeros(3)
    return Solid(np.round(solid.vertices - shift, 6), solid.faces, solid.semantics)


def _is_inside(points: NDArray[np.float64], area: MetricPolygons | None) -> NDArray[np.bool_]:
    return outlines.within(points, None if area is None else shapely.union_all(area.polygons))


def _true(side: _Side, options: ScoreOptions) -> tuple[_Side, ScoreOptions]:
    """Return a side with true lengths, and the area of interest in its scale."""
    scale, area = scale_of(side), options.area
    return scaled(side, scale), options if area is None else replace(options, area=scaled(area, scale))


def _check_same_system(result: str, reference: str, area: MetricPolygons | None) -> None:
    """Refuse sides in different reference systems; one that does not say its own is trusted."""
    given = (result, reference, "" if area is None else area.crs)
    systems = {crs: None for crs in given if crs.startswith("EPSG:")}
    if len(systems) > 1:
        raise InputError(
            f"the result, the reference and the area of interest are in {', '.join(systems)}: "
            "transform them to one reference system"
        )


def control_figures(result: Path, reference: Path, options: ScoreOptions) -> Figures:
    """Compare terrain, walls and roofs of a run with a denser, sharper cloud of the same place."""
    model = read_city_model(result)
    cloud = read_labels(reference, prefer_truth=True)
    _check_same_system(model.crs, cloud.crs, options.area)
    inside = _is_inside(cloud.points, options.area)
    points, classes = cloud.points[inside], cloud.labels[0][inside]
    is_ground = np.isin(classes, list(options.reference_classes or cells.REFERENCE_GROUND))
    figures = {"lod": options.lod, "n_points": len(points)}
    terrain = control.terrain_differences(*read_dtm(result, points[is_ground]))
    figures |= named("terrain", control.difference_figures(terrain))
    scale = scale_of(model)
    model = scaled(model, scale)
    solids = [building.finest(options.lod)[1] for building in model.buildings]
    above = points[~is_ground & ~np.isin(classes, _NO_BUILDING)] * (scale, scale, 1.0)
    return {**figures, "n_models": len(solids), **control.score_control(solids, above)}


FIGURES: dict[str, Callable[[Path, Path, ScoreOptions], Figures]] = {
    "ground": ground_figures,
    "buildings": building_figures,
    "outlines": outline_figures,
    "edges": edge_figures,
    "planes": plane_figures,
    "models": model_figures,
    "control": control_figures,
}
