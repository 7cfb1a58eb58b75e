"""The score of building models: against reference models, or against the points of roofs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.solids.validity import check_solid
from lidar_buildings.evaluation.command.options import BUILDING, ScoreOptions, check_same_system, is_inside
from lidar_buildings.evaluation.readers.city_model import CityBuilding, holds_city_model, read_city_model
from lidar_buildings.evaluation.readers.labelled_points import has_clouds, read_roof_points
from lidar_buildings.evaluation.scores.model_points import WITHIN, score_model_points
from lidar_buildings.evaluation.scores.models import ModelScore, same_roof_type, score_models
from lidar_buildings.evaluation.scores.roof_surfaces import Solids
from lidar_buildings.evaluation.scores.statistics import mean, percentile, ratio

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
