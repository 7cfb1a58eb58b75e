"""How well outlines agree with a reference: as objects, as area, along boundaries; and with their points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.evaluation.scores.polygons import (
    MIN_INSIDE,
    cut_to,
    limits_of,
    simplified,
    valid_polygons,
    vertex_counts,
)
from lidar_buildings.evaluation.scores.statistics import mean, percentile, ratio, root_mean_square

#: An object counts as found from this intersection over union on (Everingham et al. 2010, PASCAL VOC).
MIN_IOU = 0.5
#: A building counts as covered from this share of its area on.
MIN_COVERED = 0.5
#: Step between samples along a boundary: finer than any point spacing resolves [m].
STEP = 0.1
#: A sample so near to the edge of the area of interest lies on a cut, not on a boundary [m].
ON_CUT = 1e-3


@dataclass(frozen=True)
class BoundaryDistances:
    """
    How far boundaries lie apart, from each to the other, every metre of them with the same weight.

    `doc/scores.md` says what the figures are.
    """

    mean: float
    rms: float
    percentile_95: float
    hausdorff: float


@dataclass(frozen=True, eq=False)
class OutlineScore:
    """Agreement of outlines, see `doc/scores.md`; a share or mean of nothing is NaN."""

    n_result: int
    n_reference: int
    n_found: int
    n_missed: int
    n_extra: int
    completeness: float
    correctness: float
    f1: float
    mean_iou: float
    mean_iou_found: float
    area_completeness: float
    area_correctness: float
    area_iou: float
    boundary: BoundaryDistances
    boundary_of_unions: BoundaryDistances
    vertices_result: float
    vertices_reference: float
    vertices_reference_simplified: float
    n_vertices_result: int
    n_vertices_reference: int
    n_vertices_reference_simplified: int
    #: Row of the result outline that belongs to each given reference outline, −1 if none does, shape
    #: (n_given_reference,).
    partner: NDArray[np.int64]
    iou: NDArray[np.float64]  #: their intersection over union, shape (n_given_reference,)


def score_outlines(result: ArrayLike, reference: ArrayLike, *, area: ArrayLike | None = None) -> OutlineScore:
    """
    Match outlines one to one, the pair of largest IoU first, and measure how well they agree.

    With an area, where the reference is complete, both sides are cut to it. What then has no partner and lay
    mostly outside is left out: its counterpart may be outside, too. Invalid outlines are repaired. Pairs of
    IoU > 0.5 are unique where the outlines of one side do not overlap each other.
    """
    limits = limits_of(area)
    whole = valid_polygons(result), valid_polygons(reference)
    mine, mine_inside = cut_to(whole[0], limits)
    theirs, theirs_inside = cut_to(whole[1], limits)
    partner, iou = match_outlines(mine, theirs)
    mine_counted = np.isin(np.arange(len(mine)), partner) | (mine_inside >= MIN_INSIDE)
    n_result = int(np.count_nonzero(mine_counted))
    counted = (partner >= 0) | (theirs_inside >= MIN_INSIDE)
    found = np.flatnonzero(iou >= MIN_IOU)
    pairs = mine[partner[found]], theirs[found]
    unions = shapely.union_all(mine), shapely.union_all(theirs)
    common, mine_area, theirs_area = unions[0].intersection(unions[1]).area, unions[0].area, unions[1].area
    n_reference = int(np.count_nonzero(counted))
    return OutlineScore(
        n_result=n_result,
        n_reference=n_reference,
        n_found=len(found),
        n_missed=n_reference - len(found),
        n_extra=n_result - len(found),
        completeness=ratio(len(found), n_reference),
        correctness=ratio(len(found), n_result),
        f1=ratio(2 * len(found), n_result + n_reference),
        mean_iou=mean(iou[counted]),
        mean_iou_found=mean(iou[found]),
        area_completeness=ratio(common, theirs_area),
        area_correctness=ratio(common, mine_area),
        area_iou=ratio(common, mine_area + theirs_area - common),
        boundary=boundary_distances(*pairs, limits=limits),
        boundary_of_unions=distances_of_unions(*unions, limits=limits),
        vertices_result=mean(vertex_counts(pairs[0])),
        vertices_reference=mean(vertex_counts(pairs[1])),
        vertices_reference_simplified=mean(vertex_counts(simplified(pairs[1]))),
        n_vertices_result=int(vertex_counts(whole[0][mine_counted]).sum()),
        n_vertices_reference=int(vertex_counts(whole[1][counted]).sum()),
        n_vertices_reference_simplified=int(vertex_counts(simplified(whole[1][counted])).sum()),
        partner=partner,
        iou=iou,
    )


def match_outlines(
    result: NDArray[Any], reference: NDArray[Any]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """
    Give each reference outline at most one result outline and the reverse, largest IoU first.

    Returned are the partner of each reference, −1 where no outline is left that overlaps, and their IoU.
    """
    partner, best = np.full(len(reference), -1, dtype=np.int64), np.zeros(len(reference))
    theirs, mine = shapely.STRtree(result).query(reference, predicate="intersects")
    common = shapely.area(shapely.intersection(reference[theirs], result[mine]))
    iou = common / (shapely.area(reference[theirs]) + shapely.area(result[mine]) - common)
    taken = np.zeros(len(result), dtype=bool)
    for pair in np.lexsort((mine, theirs, -iou)):
        if iou[pair] > 0 and partner[theirs[pair]] < 0 and not taken[mine[pair]]:
            partner[theirs[pair]], best[theirs[pair]] = mine[pair], iou[pair]
            taken[mine[pair]] = True
    return partner, best


@dataclass(frozen=True, eq=False)
class CoverageScore:
    """Buildings of the reference under the result, see `doc/scores.md`; a share of nothing is NaN."""

    n_buildings: int
    n_covered: int
    covered_share: float
    #: Share of each given building's area that lies in the result, shape (n_given_reference,).
    covered: NDArray[np.float64]


def score_coverage(
    result: ArrayLike, reference: ArrayLike, *, area: ArrayLike | None = None
) -> CoverageScore:
    """
    Count the reference buildings that lie under the union of all result outlines.

    Where an area is given buildings are cut to it, and those mostly outside do not count.
    """
    theirs, inside = cut_to(valid_polygons(reference), limits_of(area))
    size = shapely.area(theirs)
    common = shapely.area(shapely.intersection(theirs, shapely.union_all(valid_polygons(result))))
    covered = np.divide(common, size, out=np.zeros(len(theirs)), where=size > 0)
    counted = inside >= MIN_INSIDE
    n_buildings = int(np.count_nonzero(counted))
    n_covered = int(np.count_nonzero(counted & (covered >= MIN_COVERED)))
    return CoverageScore(n_buildings, n_covered, ratio(n_covered, n_buildings), covered)


@dataclass(frozen=True)
class AdjustmentScore:
    """Means over buildings with straight or curved walls, see `doc/scores.md`; NaN if there are none."""

    n_buildings: int
    n_as_traced: int
    spacing: float
    max_offset: float
    sigma: float
    max_offset_share: float
    sigma_share: float


def score_adjustment(spacing: ArrayLike, sigma: ArrayLike, max_offset: ArrayLike) -> AdjustmentScore:
    """
    Average what the least squares adjustment says of its buildings, as the paper does.

    NaN is unknown; σ = 0 where the outline is the traced one. ValueError if the lengths differ.
    """
    columns = [np.asarray(column, dtype=np.float64) for column in (spacing, sigma, max_offset)]
    if len({column.shape for column in columns}) > 1:
        shapes = [column.shape for column in columns]
        raise ValueError(f"spacing, sigma and max_offset have shapes {shapes}: must be one per building")
    known = np.isfinite(columns).all(axis=0)
    fitted = known & (columns[1] > 0)
    count = int(fitted.sum())
    spacings, sigmas, offsets = (column[fitted] for column in columns)
    means = mean(spacings), mean(offsets), root_mean_square(sigmas)
    return AdjustmentScore(
        n_buildings=count,
        n_as_traced=int((known & ~fitted).sum()),
        spacing=means[0],
        max_offset=means[1],
        sigma=means[2],
        max_offset_share=ratio(means[1], means[0]),
        sigma_share=ratio(means[2], means[0]),
    )


def boundary_distances(
    result: NDArray[Any], reference: NDArray[Any], *, limits: shapely.Geometry | None = None
) -> BoundaryDistances:
    """
    Measure the distances between the boundaries of pairs of outlines, courtyards included.

    Along the edge of the limits that both were cut to nothing is measured.
    """
    cut = None if limits is None else shapely.boundary(limits)
    along, corners = [np.empty(0)], [np.empty(0)]
    for mine, theirs in zip(shapely.boundary(result), shapely.boundary(reference), strict=True):
        for one, other in ((mine, theirs), (theirs, mine)):
            shapely.prepare(other)
            along.append(shapely.distance(_off_cut(_samples(one), cut), other))
            corners.append(
                shapely.distance(_off_cut(shapely.points(shapely.get_coordinates(one)), cut), other)
            )
    distance, at_corner = np.concatenate(along), np.concatenate(corners)
    return BoundaryDistances(
        mean=mean(distance),
        rms=root_mean_square(distance),
        percentile_95=percentile(distance, 95),
        hausdorff=max(percentile(distance, 100), float(at_corner.max(initial=0.0))),
    )


def distances_of_unions(
    result: shapely.Geometry, reference: shapely.Geometry, *, limits: shapely.Geometry | None = None
) -> BoundaryDistances:
    """
    Measure the distances between the boundaries of what both sides cover; NaN if either covers nothing.

    Along the edge of the limits that both were cut to nothing is measured.
    """
    sides = [[] if side.is_empty else [side] for side in (result, reference)]
    if not all(sides):
        sides = [[], []]
    mine, theirs = (np.array(side, dtype=object) for side in sides)
    return boundary_distances(mine, theirs, limits=limits)


def _samples(boundary: shapely.Geometry) -> NDArray[Any]:
    samples = []
    for ring in shapely.get_parts(boundary):
        n_steps = max(1, math.ceil(ring.length / STEP))
        share = (np.arange(n_steps) + 0.5) / n_steps
        samples.append(shapely.line_interpolate_point(ring, share, normalized=True))
    return np.concatenate(samples)


def _off_cut(samples: NDArray[Any], cut: shapely.Geometry | None) -> NDArray[Any]:
    """Return the samples that do not lie on the edge of the area of interest."""
    return samples if cut is None else samples[~shapely.dwithin(samples, cut, ON_CUT)]
