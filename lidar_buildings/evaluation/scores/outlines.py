"""How well outlines agree with a reference: as objects, as area, along boundaries, by corners and walls."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from lidar_buildings.core.model.outline import ring_walls
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
    """Return valid polygons without vertices on straight walls, within a tolerance (Douglas-Peucker)."""
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
    one, other = shapely.STRtree(given).query(given, predicate="dwithin", distance=TOUCHING)
    one, other = one[one != other], other[one != other]
    near = shapely.intersection(shapely.boundary(given[one]), shapely.buffer(given[other], TOUCHING))
    shares_wall = shapely.length(near) >= MIN_WALL
    block = sets_of_pairs(len(given), one[shares_wall], other[shares_wall])
    members = [given[block == number] for number in np.unique(block)]
    return np.array([one[0] if len(one) == 1 else _closed(one) for one in members], dtype=object)


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
    counted = (partner >= 0) | (theirs_inside >= MIN_INSIDE)
    found = np.flatnonzero(iou >= MIN_IOU)
    pairs = mine[partner[found]], theirs[found]
    unions = shapely.union_all(mine), shapely.union_all(theirs)
    # Nothing is measured where either covers nothing.
    covered = (np.array([one], dtype=object)[: 0 if any(u.is_empty for u in unions) else 1] for one in unions)
    common, mine_area, theirs_area = unions[0].intersection(unions[1]).area, unions[0].area, unions[1].area
    n_result, n_reference = int(np.count_nonzero(mine_counted)), int(np.count_nonzero(counted))
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
        **named("boundary_of_unions", boundary_distances(*covered, limits=limits)),
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
    """Return the partner of each reference, −1 without, and their IoU; one to one, the largest IoU first."""
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
    """Return the share of reference buildings, in the area, of which half or more lies under the result."""
    theirs, inside = cut_to(valid_polygons(reference), limits_of(area))
    theirs = theirs[inside >= MIN_INSIDE]
    common = shapely.area(shapely.intersection(theirs, shapely.union_all(valid_polygons(result))))
    return mean(common >= MIN_COVERED * shapely.area(theirs))


def boundary_distances(
    result: NDArray[Any], reference: NDArray[Any], *, limits: shapely.Geometry | None = None
) -> Figures:
    """Measure distances between boundaries of pairs of outlines, but along the edge of the limits."""
    cut = None if limits is None else shapely.boundary(limits)
    along, corners = [np.empty(0)], [np.empty(0)]
    for mine, theirs in zip(shapely.boundary(result), shapely.boundary(reference), strict=True):
        for one, other in ((mine, theirs), (theirs, mine)):
            shapely.prepare(other)
            vertices = shapely.points(shapely.get_coordinates(one))
            along.append(shapely.distance(_off_cut(_samples(one), cut), other))
            corners.append(shapely.distance(_off_cut(vertices, cut), other))
    distance, at_corner = np.concatenate(along), np.concatenate(corners)
    return {
        "mean": mean(distance),
        "percentile_95": percentile(distance, 95),
        "hausdorff": max(percentile(distance, 100), float(at_corner.max(initial=0.0))),
    }


def _samples(boundary: shapely.Geometry) -> NDArray[Any]:
    samples = []
    for ring in shapely.get_parts(boundary):
        n_steps = max(1, math.ceil(ring.length / STEP))
        share = (np.arange(n_steps) + 0.5) / n_steps
        samples.append(shapely.line_interpolate_point(ring, share, normalized=True))
    return np.concatenate(samples)


def _off_cut(samples: NDArray[Any], cut: shapely.Geometry | None) -> NDArray[Any]:
    return samples if cut is None else samples[~shapely.dwithin(samples, cut, ON_CUT)]


#: How far a corner may lie from the one that it stands for: two spacings of dense surveys, one of sparse [m].
DEFAULT_TOLERANCE = 1.0
#: A vertex that turns less is part of a curve or of a wall that is not quite straight [deg].
MIN_TURN_DEG = 10.0


def score_corners(
    result: ArrayLike,
    reference: ArrayLike,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    area: ArrayLike | None = None,
) -> Figures:
    """Match corners of polygons, one a building, one to one, and count the rest; inside an area if given."""
    limits = limits_of(area)
    corners = (corners_of(valid_polygons(side)) for side in (result, reference))
    mine, theirs = (own[within(own, limits)] for own in corners)
    _, _, distances = match_corners(mine, theirs, tolerance)
    return {
        "n_result": len(mine),
        "n_reference": len(theirs),
        "n_matched": len(distances),
        "precision": ratio(len(distances), len(mine)),
        "recall": ratio(len(distances), len(theirs)),
        "mean_distance": mean(distances),
    }


def corners_of(polygons: NDArray[Any]) -> NDArray[np.float64]:
    """Return the vertices, of courtyards too, at which simplified valid outlines turn by 10° or more."""
    corners = [ring[_turns(ring) > math.radians(MIN_TURN_DEG)] for ring in open_rings(simplified(polygons))]
    return np.concatenate([*corners, np.empty((0, 2))])


def _turns(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    after = np.roll(ring, -1, axis=0) - ring
    before = np.roll(after, 1, axis=0)
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.abs(np.arctan2(cross, (before * after).sum(axis=1)))


def match_corners(
    result: NDArray[np.float64], reference: NDArray[np.float64], tolerance: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Pair points within the tolerance one to one, most first, then nearest: rows of both, distances."""
    if not (len(result) and len(reference)):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty(0)
    near = cKDTree(result).sparse_distance_matrix(cKDTree(reference), tolerance, output_type="ndarray")
    # What is within reach of one another falls apart into small groups, each solved on its own.
    groups = sets_of_pairs(len(result) + len(reference), near["i"], near["j"] + len(result))
    order = np.argsort(groups[near["i"]], kind="stable")
    cuts = np.flatnonzero(np.diff(groups[near["i"][order]])) + 1
    pairs = [_assigned(near[rows], tolerance) for rows in np.split(order, cuts) if len(rows)]
    found = np.concatenate([*pairs, np.empty((0, 3))])
    return found[:, 0].astype(np.int64), found[:, 1].astype(np.int64), found[:, 2]


def _assigned(near: NDArray[np.void], tolerance: float) -> NDArray[np.float64]:
    """Solve one group of possible pairs; return rows of (result, reference, distance)."""
    mine, i = np.unique(near["i"], return_inverse=True)
    theirs, j = np.unique(near["j"], return_inverse=True)
    # No pair costs more than all the distances that it could save, so that as many as possible are made.
    cost = np.full((len(mine), len(theirs)), 2 * tolerance * (1 + min(len(mine), len(theirs))))
    cost[i, j] = near["v"]
    rows, columns = linear_sum_assignment(cost)
    kept = cost[rows, columns] <= tolerance
    rows, columns = rows[kept], columns[kept]
    return np.column_stack([mine[rows], theirs[columns], cost[rows, columns]])


#: Step between samples along a wall: finer than any point spacing resolves [m].
WALL_STEP = 0.25
#: A wall stands for a wall of the reference if at least half of it is no further away than this [m].
DEFAULT_REACH = 1.0


def score_directions(
    result: NDArray[Any],
    reference: NDArray[Any],
    *,
    reach: float = DEFAULT_REACH,
    limits: shapely.Geometry | None = None,
) -> Figures:
    """
    Compare the directions of walls, outline by outline, every metre with the same weight; rows are partners.

    A result's wall belongs to the reference's wall that is the nearest to most of its length, within `reach`
    [m]. Only walls with their middle inside the limits count, where they are given.
    """
    angles, lengths = [np.empty(0)], [np.empty(0)]
    for mine, theirs in zip(result, simplified(reference), strict=True):
        walls = _walls(mine)
        walls = walls[within(walls.mean(axis=1), limits)]
        angles.append(_angles(walls, _walls(theirs), reach))
        lengths.append(np.hypot(*(walls[:, 1] - walls[:, 0]).T))
    angle, length = np.concatenate(angles), np.concatenate(lengths)
    matched = np.isfinite(angle)
    return {
        "median_deg": _weighted_quantile(angle[matched], length[matched], 0.5),
        "percentile_95_deg": _weighted_quantile(angle[matched], length[matched], 0.95),
        "matched_share": ratio(float(length[matched].sum()), float(length.sum())),
    }


def _walls(polygon: shapely.Geometry) -> NDArray[np.float64]:
    ends = ring_walls(open_rings(np.array([polygon], dtype=object)))
    return ends[(ends[:, 0] != ends[:, 1]).any(axis=1)]


def _angles(mine: NDArray[np.float64], theirs: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
    """Return the angle of each wall to the one that it stands for [deg], NaN where there is none."""
    angle = np.full(len(mine), np.nan)
    if not (len(mine) and len(theirs)):
        return angle
    owner, spots = spots_along(mine, WALL_STEP)
    tree = shapely.STRtree(shapely.linestrings(theirs))
    (sample, wall), distance = tree.query_nearest(
        shapely.points(spots), return_distance=True, all_matches=False
    )
    order = np.argsort(sample)
    nearest, distance = wall[order], distance[order]
    share_near = np.bincount(owner, distance <= reach) / np.bincount(owner)
    partner = _most_frequent(owner, nearest)
    own, other = (np.arctan2(*(walls[:, 1] - walls[:, 0]).T[::-1]) for walls in (mine, theirs))
    difference = np.rad2deg(own - other[partner])
    folded = np.abs((difference + 90.0) % 180.0 - 90.0)
    return np.where(share_near >= 0.5, folded, np.nan)


def _most_frequent(owner: NDArray[np.int64], value: NDArray[np.int64]) -> NDArray[np.int64]:
    pairs, count = np.unique(np.column_stack((owner, value)), axis=0, return_counts=True)
    order = np.lexsort((pairs[:, 1], -count, pairs[:, 0]))
    first = np.unique(pairs[order, 0], return_index=True)[1]
    return np.asarray(pairs[order, 1][first], dtype=np.int64)


def _weighted_quantile(values: NDArray[np.float64], weights: NDArray[np.float64], share: float) -> float:
    if not len(values):
        return math.nan
    order = np.argsort(values)
    reached = np.cumsum(weights[order]) >= share * weights.sum() * (1 - 1e-12)
    return float(values[order][reached.argmax()])
