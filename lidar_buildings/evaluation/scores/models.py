"""Building models against reference models, and against the points of roofs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.model.point_array import checked_points
from lidar_buildings.core.solids.shell import ROOF_SURFACE
from lidar_buildings.evaluation.scores.cells import mean, percentile, ratio, root_mean_square
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
    RidgeScore,
    Solids,
    Wireframe,
    WireframeScore,
    faces_of,
    footprints,
    n_corners,
    roof_surfaces,
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


@dataclass(frozen=True)
class HeightDifferences:
    """
    Elevation of the result's roofs less that of the reference's, where both have one; NaN of nothing.

    `doc/scores.md` says what the figures are.
    """

    covered: float
    bias: float
    rmse: float
    percentile_95: float
    largest: float


@dataclass(frozen=True)
class SolidCounts:
    """What the models of matched buildings consist of, see `doc/scores.md`; NaN of nothing."""

    vertices_result: float
    vertices_reference: float
    corners_result: float
    corners_reference: float
    roof_faces_result: float
    roof_faces_reference: float
    same_corners: float


@dataclass(frozen=True, eq=False)
class ModelScore:
    """
    Agreement of building models.

    `doc/scores.md` says what the figures are.
    """

    n_result: int
    n_reference: int
    n_matched: int
    heights: HeightDifferences
    #: The same per building of the reference, NaN where the result has no roof [m], shape
    #: (n_given_reference,).
    rmse: NDArray[np.float64]
    #: Volume of the partner / of the building, NaN without a partner, shape (n_given_reference,).
    volume_ratio: NDArray[np.float64]
    #: Row of the partner in the result, −1 if there is none, shape (n_given_reference,).
    partner: NDArray[np.int64]
    ridges: RidgeScore
    wireframe: WireframeScore
    counts: SolidCounts


def score_models(
    result: Sequence[Solids],
    reference: Sequence[Solids],
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    area: ArrayLike | None = None,
) -> ModelScore:
    """
    Compare building models with reference models, in an area if one is given.

    Roofs are compared spot by spot and wireframes line by line, however either side divides blocks into
    buildings; volumes and numbers of vertices building by building, matched by their footprints. Corners,
    edges and ridges may lie `tolerance` [m] from those that they stand for; ValueError if that is not a
    positive number.
    """
    limits = limits_of(area)
    grounds = [valid_polygons(footprints(side)) for side in (result, reference)]
    (mine, mine_inside), (theirs, theirs_inside) = (cut_to(ground, limits) for ground in grounds)
    partner, iou = match_outlines(mine, theirs)
    partner = np.where(iou >= MIN_IOU, partner, -1)
    counted = (partner >= 0) | (theirs_inside >= MIN_INSIDE)
    mine_counted = np.isin(np.arange(len(mine)), partner) | (mine_inside >= MIN_INSIDE)
    rows, differences = _differences(result, reference, theirs)
    my_frame, true_frame = (_inside(roof_wireframe(_parts(side)), limits) for side in (result, reference))
    pairs = [(result[mine], reference[row]) for row, mine in enumerate(partner.tolist()) if mine >= 0]
    return ModelScore(
        n_result=int(np.count_nonzero(mine_counted)),
        n_reference=int(np.count_nonzero(counted)),
        n_matched=len(pairs),
        heights=_heights(differences),
        rmse=np.array([root_mean_square(differences[rows == row]) for row in range(len(reference))]),
        volume_ratio=_volume_ratios(result, reference, partner),
        partner=partner,
        ridges=score_ridges(my_frame, true_frame, tolerance),
        wireframe=score_wireframes(my_frame, true_frame, tolerance),
        counts=_counts(pairs),
    )


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


def _differences(
    result: Sequence[Solids], reference: Sequence[Solids], grounds: NDArray[Any]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return each spot's building of the reference and the difference there [m], NaN without a result."""
    spots = [grid_spots(ground, STEP) for ground in grounds]
    row = np.repeat(np.arange(len(spots)), [len(one) for one in spots])
    xy = np.concatenate([*spots, np.empty((0, 2))])
    true = roof_surfaces(reference).over(xy)[1]
    found = roof_surfaces(result).over(xy)[1]
    has_roof = np.isfinite(true)
    return row[has_roof], (found - true)[has_roof]


def _heights(differences: NDArray[np.float64]) -> HeightDifferences:
    found = differences[np.isfinite(differences)]
    return HeightDifferences(
        covered=ratio(len(found), len(differences)),
        bias=mean(found),
        rmse=root_mean_square(found),
        percentile_95=percentile(np.abs(found), 95),
        largest=percentile(np.abs(found), 100),
    )


def _volume_ratios(
    result: Sequence[Solids], reference: Sequence[Solids], partner: NDArray[np.int64]
) -> NDArray[np.float64]:
    volumes = [[sum(solid.volume for solid in parts) for parts in side] for side in (result, reference)]
    pairs = zip(partner.tolist(), volumes[1], strict=True)
    return np.array([math.nan if mine < 0 else ratio(volumes[0][mine], true) for mine, true in pairs])


def _counts(pairs: list[tuple[Solids, Solids]]) -> SolidCounts:
    if not pairs:
        return SolidCounts(*(math.nan,) * 7)
    corners = [[sum(map(n_corners, parts)) for parts in pair] for pair in pairs]
    vertices = [[sum(len(solid.vertices) for solid in parts) for parts in pair] for pair in pairs]
    faces = [[sum(len(faces_of(s, ROOF_SURFACE)) for s in parts) for parts in pair] for pair in pairs]
    (my_vertices, true_vertices), (my_corners, true_corners), (my_faces, true_faces) = (
        np.mean(counts, axis=0).tolist() for counts in (vertices, corners, faces)
    )
    return SolidCounts(
        vertices_result=my_vertices,
        vertices_reference=true_vertices,
        corners_result=my_corners,
        corners_reference=true_corners,
        roof_faces_result=my_faces,
        roof_faces_reference=true_faces,
        same_corners=float(np.mean([mine == theirs for mine, theirs in corners])),
    )


def _parts(side: Sequence[Solids]) -> list[Any]:
    return [solid for parts in side for solid in parts]


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
    """Return a word in small letters with hyphens."""
    return word.strip().lower().replace("_", "-").replace(" ", "-")


#: The distances within which points are counted [m].
WITHIN = (0.1, 0.2, 0.5)
#: A building with fewer points has no RMSE; wide margin: roofs have hundreds.
MIN_POINTS = 10


@dataclass(frozen=True, eq=False)
class ModelPointScore:
    """Vertical distances of points to roofs, see `doc/scores.md`; a share or mean of nothing is NaN."""

    n_points: int
    uncovered: float
    median: float
    bias: float
    rmse: float
    within: tuple[float, ...]  #: shares of the points within 0.1, 0.2 and 0.5 m of the roof
    building_rmse_median: float
    building_rmse_95: float
    n_buildings: int
    rmse_per_building: NDArray[np.float64]  #: NaN with fewer than ten points [m], shape (n_given_buildings,)


def score_model_points(buildings: Sequence[Solids], points: ArrayLike) -> ModelPointScore:
    """Measure how far roof points lie above or below the roof at their place, and whose roof that is."""
    cloud = checked_points(points)
    building, elevation = roof_surfaces(buildings).over(cloud)
    is_on = building >= 0
    distance = (cloud[:, 2] - elevation)[is_on]
    per_building = _rmse_per_building(distance, building[is_on], len(buildings))
    known = per_building[np.isfinite(per_building)]
    return ModelPointScore(
        n_points=len(cloud),
        uncovered=ratio(len(cloud) - len(distance), len(cloud)),
        median=percentile(np.abs(distance), 50),
        bias=mean(distance),
        rmse=root_mean_square(distance),
        within=tuple(
            ratio(int(np.count_nonzero(np.abs(distance) <= limit)), len(distance)) for limit in WITHIN
        ),
        building_rmse_median=percentile(known, 50),
        building_rmse_95=percentile(known, 95),
        n_buildings=len(known),
        rmse_per_building=per_building,
    )


def _rmse_per_building(
    distance: NDArray[np.float64], building: NDArray[np.int64], n_buildings: int
) -> NDArray[np.float64]:
    """Return the root of each building's mean square distance [m], NaN with few points."""
    count = np.bincount(building, minlength=n_buildings)
    squares = np.bincount(building, distance**2, minlength=n_buildings)
    mean_square = np.divide(squares, count, out=np.full(n_buildings, np.nan), where=count >= MIN_POINTS)
    return np.sqrt(mean_square)
