"""Building models against reference models, and against the points of roofs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.model.point_array import checked_points
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.evaluation.scores.cells import Figures, mean, named, percentile, ratio, root_mean_square
from lidar_buildings.evaluation.scores.outlines import (
    MIN_INSIDE,
    MIN_IOU,
    cut_to,
    limits_of,
    match_outlines,
    valid_polygons,
    within,
)
from lidar_buildings.evaluation.scores.wireframe import (
    Solids,
    Wireframe,
    footprints,
    roof_elevations,
    roof_wireframe,
    score_ridges,
    score_wireframes,
)

#: Roofs are compared on a grid of this step [m], whose lines lie at multiples of it.
STEP = 0.25
#: How far a corner, an edge or a ridge may lie from the one that it stands for, unless told otherwise [m].
DEFAULT_TOLERANCE = 1.0
#: Roof type of a reference → the types of a result that mean the same, or the same of its largest part.
_ALSO: dict[str, set[str]] = {
    "hip": {"pyramid"},
    "l": {"l-shape"},
    "t": {"t-shape"},
    "l-shape": {"l"},
    "t-shape": {"t"},
    "hipped-l": {"l", "l-shape", "complex"},
    "cross-gable": {"complex", "t", "t-shape"},
    "round-tower": {"pyramid", "complex"},
    "dormer": {"gable"},
    "gable-dormer": {"gable"},
    "church": {"gable"},
    "parapet": {"flat"},
    "step": {"flat"},
}
#: Shapes that have no word of their own in results.
_COMPLEX = {
    *("barrel", "church", "courtyard", "dormer", "double-gable", "gable-dormer", "gambrel", "mansard"),
    *("parapet", "sawtooth", "step"),
}


def score_models(
    result: Sequence[Solids],
    reference: Sequence[Solids],
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    area: ArrayLike | None = None,
) -> Figures:
    """
    Compare building models with reference models, in an area if one is given.

    Roofs are compared spot by spot and wireframes line by line, however either side divides blocks into
    buildings; volumes building by building, matched by their footprints. Corners, edges and ridges may lie
    `tolerance` [m] from those that they stand for. Beside the figures, arrays give each reference building's
    partner, −1 without, and its volume ratio, NaN without.
    """
    limits = limits_of(area)
    grounds = [valid_polygons(footprints(side)) for side in (result, reference)]
    (mine, mine_inside), (theirs, theirs_inside) = (cut_to(ground, limits) for ground in grounds)
    partner, iou = match_outlines(mine, theirs)
    partner = np.where(iou >= MIN_IOU, partner, -1)
    counted = (partner >= 0) | (theirs_inside >= MIN_INSIDE)
    mine_counted = np.isin(np.arange(len(mine)), partner) | (mine_inside >= MIN_INSIDE)
    solids = [[solid for parts in side for solid in parts] for side in (result, reference)]
    my_frame, true_frame = (_inside(roof_wireframe(side), limits) for side in solids)
    volumes = [[sum(solid.volume for solid in parts) for parts in side] for side in (result, reference)]
    pairs = zip(partner.tolist(), volumes[1], strict=True)
    ratios = np.array([math.nan if k < 0 else ratio(volumes[0][k], true) for k, true in pairs])
    return {
        "n_models_result": int(np.count_nonzero(mine_counted)),
        "n_models_reference": int(np.count_nonzero(counted)),
        "n_matched": int(np.count_nonzero(partner >= 0)),
        **named("height", _heights(*solids, theirs)),
        "volume_ratio": mean(ratios[np.isfinite(ratios)]),
        **named("ridge", score_ridges(my_frame, true_frame, tolerance)),
        **named("roof", score_wireframes(my_frame, true_frame, tolerance)),
        "partner_per_reference": partner,
        "volume_ratio_per_reference": ratios,
    }


def grid_spots(polygon: shapely.Geometry, step: float) -> NDArray[np.float64]:
    """Return the crossings of a grid's lines within a polygon, shape (n, 2) [m]."""
    if polygon.is_empty:
        return np.empty((0, 2))
    west, south, east, north = polygon.bounds
    x = step * np.arange(math.ceil(west / step), math.floor(east / step) + 1)
    y = step * np.arange(math.ceil(south / step), math.floor(north / step) + 1)
    spots = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    shapely.prepare(polygon)
    return np.asarray(spots[shapely.contains_xy(polygon, spots)])


def _heights(result: list[Solid], reference: list[Solid], grounds: NDArray[Any]) -> Figures:
    """Compare the elevations of both sides' roofs on a grid over the reference's grounds."""
    spots = np.concatenate([*(grid_spots(ground, STEP) for ground in grounds), np.empty((0, 2))])
    true = roof_elevations(reference, spots)
    has_roof = np.isfinite(true)
    differences = roof_elevations(result, spots[has_roof]) - true[has_roof]
    found = differences[np.isfinite(differences)]
    return {
        "covered": ratio(len(found), len(differences)),
        "bias": mean(found),
        "rmse": root_mean_square(found),
        "percentile_95": percentile(np.abs(found), 95),
    }


def _inside(frame: Wireframe, limits: shapely.Geometry | None) -> Wireframe:
    kept = within(frame.corners, limits)
    rows = np.cumsum(kept) - 1
    edges = kept[frame.edges].all(axis=1)
    return Wireframe(frame.corners[kept], rows[frame.edges[edges]], frame.is_ridge[edges])


def same_roof_type(found: str, true: Mapping[str, Any]) -> bool:
    """
    Whether a result's word for a roof says what the reference's attributes say.

    Whatever the outline's shape, one level plane, where `n_planes` is known, is a flat roof.
    """
    mine, theirs = _plain(found), _plain(str(true["roof_type"]))
    types = {theirs} | _ALSO.get(theirs, set())
    if theirs in _COMPLEX:
        types.add("complex")
    if true.get("n_planes") == 1 and theirs != "shed":
        types = {"flat", theirs}
    return mine in types


def _plain(word: str) -> str:
    return word.strip().lower().replace("_", "-").replace(" ", "-")


#: The distances within which points are counted [m].
WITHIN = (0.1, 0.2, 0.5)


def score_model_points(buildings: Sequence[Solids], points: ArrayLike) -> Figures:
    """Measure how far roof points lie above or below the roof at their place."""
    cloud = checked_points(points)
    distance = cloud[:, 2] - roof_elevations([solid for parts in buildings for solid in parts], cloud)
    distance = np.abs(distance[np.isfinite(distance)])
    return {
        "n_points": len(cloud),
        "uncovered": ratio(len(cloud) - len(distance), len(cloud)),
        "median": percentile(distance, 50),
        "rmse": root_mean_square(distance),
        **{f"within_{100 * d:.0f}_cm": ratio(int((distance <= d).sum()), len(distance)) for d in WITHIN},
    }
