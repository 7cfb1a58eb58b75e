"""How well outlines agree with a reference: as objects, as area, and along boundaries."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.evaluation.scores.cells import Figures, mean, named, percentile, ratio

#: An object that the area of interest cuts and nothing answers counts if so much of it lies inside.
MIN_INSIDE = 0.5
#: A vertex so near to the line between its neighbours is on it: maps are drawn to about that [m].
STRAIGHT = 0.1


def valid_polygons(polygons: ArrayLike) -> NDArray[Any]:
    """Return the geometries as an array, repaired, with None and what has no area as an empty polygon."""
    given = np.atleast_1d(np.asarray(polygons, dtype=object))
    valid = shapely.make_valid(shapely.force_2d(given))
    # A repair can leave dangling lines beside the polygons: a zero-width buffer keeps the areas alone.
    valid = np.where(shapely.get_dimensions(valid) == 2, shapely.buffer(valid, 0.0), shapely.Polygon())
    return np.asarray(valid, dtype=object)


def limits_of(area: ArrayLike | None) -> shapely.Geometry | None:
    """Return the union of an area of interest's polygons, None if there is no such area."""
    return None if area is None else shapely.union_all(valid_polygons(area))


def within(places: NDArray[np.float64], limits: shapely.Geometry | None) -> NDArray[np.bool_]:
    """Tell which places, shape (n, 2) or (n, 3), lie in limits or on their edge; all where there are none."""
    if limits is None:
        return np.ones(len(places), dtype=bool)
    shapely.prepare(limits)
    return np.asarray(shapely.intersects_xy(limits, places[:, 0], places[:, 1]), dtype=bool)


def cut_to(
    polygons: NDArray[Any], limits: shapely.Geometry | None
) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Cut polygons to the limits; return them with the share of their area that is left, 0 for empty ones."""
    whole = shapely.area(polygons)
    if limits is not None:
        polygons = valid_polygons(shapely.intersection(polygons, limits))
    return polygons, np.divide(shapely.area(polygons), whole, out=np.zeros(len(whole)), where=whole > 0)


def simplified(polygons: NDArray[Any], tolerance: float = STRAIGHT) -> NDArray[Any]:
    """
    Return valid polygons without vertices on straight walls, within a tolerance (Douglas & Peucker, 1973).
    """
    return np.asarray(shapely.simplify(polygons, tolerance, preserve_topology=True), dtype=object)


def open_rings(polygons: NDArray[Any]) -> list[NDArray[np.float64]]:
    """Return the coordinates of all rings, without the repeated vertex that closes them."""
    return [shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(polygons)]


def spots_along(lines: NDArray[np.float64], step: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return spots along lines of shape (n, 2, dimensions), after the row of each spot's line [m]."""
    vectors = lines[:, 1] - lines[:, 0]
    counts = np.maximum(np.ceil(np.linalg.norm(vectors, axis=1) / step).astype(np.int64), 1)
    row = np.repeat(np.arange(len(lines)), counts)
    place = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    return row, lines[row, 0] + ((place + 0.5) / counts[row])[:, None] * vectors[row]


#: Walls so near to each other are one: maps are drawn to centimetres [m].
TOUCHING = 0.05
#: A shorter stretch of contact is a corner, not a wall: square corners that meet share some 0.1 m [m].
MIN_WALL = 0.5


def merge_touching(buildings: ArrayLike) -> NDArray[Any]:
    """
    Merge buildings that touch along a line, or overlap, into blocks, in the order of their first buildings.

    Two buildings, invalid ones repaired, belong together if the outline of one runs within `TOUCHING` of the
    other for at least half a metre. Those that meet at a corner only stay apart. Gaps in a block are closed.
    """
    given = valid_polygons(buildings)
    block = sets_of_pairs(len(given), *_touching_pairs(given))
    members = [given[block == number] for number in np.unique(block)]
    return np.array([one[0] if len(one) == 1 else _closed(one) for one in members], dtype=object)


def _touching_pairs(polygons: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    one, other = shapely.STRtree(polygons).query(polygons, predicate="dwithin", distance=TOUCHING)
    one, other = one[one != other], other[one != other]
    near = shapely.intersection(shapely.boundary(polygons[one]), shapely.buffer(polygons[other], TOUCHING))
    shares_wall = shapely.length(near) >= MIN_WALL
    return one[shares_wall], other[shares_wall]


def _closed(members: NDArray[Any]) -> Any:
    grown = shapely.union_all(shapely.buffer(members, TOUCHING / 2, join_style="mitre"))
    shrunk = shapely.buffer(grown, -TOUCHING / 2, join_style="mitre")
    return shapely.union_all([*members, shrunk])


#: An object counts as found from this intersection over union on (Everingham et al. 2010, PASCAL VOC).
MIN_IOU = 0.5
#: A building counts as covered from this share of its area on.
MIN_COVERED = 0.5
#: Step between samples along a boundary: finer than any point spacing resolves [m].
STEP = 0.1
#: A sample so near to the edge of the area of interest lies on a cut, not on a boundary [m].
ON_CUT = 1e-3


def score_outlines(result: ArrayLike, reference: ArrayLike, *, area: ArrayLike | None = None) -> Figures:
    """
    Match outlines one to one, the pair of largest IoU first, and measure how well they agree.

    With an area, where the reference is complete, both sides are cut to it. What then has no partner and lay
    mostly outside is left out: its counterpart may be outside, too. Invalid outlines are repaired. Pairs of
    IoU > 0.5 are unique where the outlines of one side do not overlap each other. Beside the figures, arrays
    give the row of each reference outline's partner, −1 without, and their IoU.
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
    return {
        "n_result": n_result,
        "n_reference": n_reference,
        "n_found": len(found),
        "completeness": ratio(len(found), n_reference),
        "correctness": ratio(len(found), n_result),
        "f1": ratio(2 * len(found), n_result + n_reference),
        "mean_iou": mean(iou[counted]),
        "mean_iou_found": mean(iou[found]),
        "area_completeness": ratio(common, theirs_area),
        "area_correctness": ratio(common, mine_area),
        "area_iou": ratio(common, mine_area + theirs_area - common),
        **named("boundary", boundary_distances(*pairs, limits=limits)),
        **named("boundary_of_unions", _distances_of_unions(unions, limits)),
        "n_vertices_result": _n_vertices(whole[0][mine_counted]),
        "n_vertices_reference": _n_vertices(simplified(whole[1][counted])),
        "partner_per_reference": partner,
        "iou_per_reference": iou,
    }


def _n_vertices(polygons: NDArray[Any]) -> int:
    return int(shapely.get_num_coordinates(polygons).sum()) - len(shapely.get_rings(polygons))


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


def covered_share(result: ArrayLike, reference: ArrayLike, *, area: ArrayLike | None = None) -> float:
    """
    Return the share of the reference's buildings of which half or more lies under the result; NaN of nothing.

    Where an area is given buildings are cut to it, and those mostly outside do not count.
    """
    theirs, inside = cut_to(valid_polygons(reference), limits_of(area))
    theirs = theirs[inside >= MIN_INSIDE]
    common = shapely.area(shapely.intersection(theirs, shapely.union_all(valid_polygons(result))))
    return mean(common >= MIN_COVERED * shapely.area(theirs))


def boundary_distances(
    result: NDArray[Any], reference: NDArray[Any], *, limits: shapely.Geometry | None = None
) -> Figures:
    """
    Measure the distances between the boundaries of pairs of outlines, courtyards included.

    Every metre has the same weight. Along the edge of the limits that both were cut to nothing is measured.
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
    return {
        "mean": mean(distance),
        "percentile_95": percentile(distance, 95),
        "hausdorff": max(percentile(distance, 100), float(at_corner.max(initial=0.0))),
    }


def _distances_of_unions(
    unions: tuple[shapely.Geometry, shapely.Geometry], limits: shapely.Geometry | None
) -> Figures:
    """Measure the distances between the boundaries of what both sides cover; NaN if either covers nothing."""
    n_compared = 0 if any(one.is_empty for one in unions) else 1
    mine, theirs = (np.array([one], dtype=object)[:n_compared] for one in unions)
    return boundary_distances(mine, theirs, limits=limits)


def _samples(boundary: shapely.Geometry) -> NDArray[Any]:
    samples = []
    for ring in shapely.get_parts(boundary):
        n_steps = max(1, math.ceil(ring.length / STEP))
        share = (np.arange(n_steps) + 0.5) / n_steps
        samples.append(shapely.line_interpolate_point(ring, share, normalized=True))
    return np.concatenate(samples)


def _off_cut(samples: NDArray[Any], cut: shapely.Geometry | None) -> NDArray[Any]:
    return samples if cut is None else samples[~shapely.dwithin(samples, cut, ON_CUT)]
