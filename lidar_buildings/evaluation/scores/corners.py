"""Corners and directions of outlines against those of references."""

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
from lidar_buildings.evaluation.scores.cells import Figures, mean, ratio
from lidar_buildings.evaluation.scores.outlines import (
    limits_of,
    open_rings,
    simplified,
    spots_along,
    valid_polygons,
    within,
)

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
    """
    Match corners one to one, as `match_corners` does, and count what is left on either side.

    Polygons are one a building, invalid ones are repaired; only corners inside an area count, where one is
    given.
    """
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
    """
    Return the vertices at which simplified valid outlines turn by more than ten degrees, ring after ring.

    Courtyards' corners included; where buildings touch, every one's own.
    """
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
    """
    Pair points within the tolerance one to one: the most pairs, and of these the least sum of distances.

    Returned are the rows of both, and the distances.
    """
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
STEP = 0.25
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
    owner, spots = spots_along(mine, STEP)
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
    """Return the most frequent value of every owner 0, 1, …; the smallest of those that are."""
    pairs, count = np.unique(np.column_stack((owner, value)), axis=0, return_counts=True)
    order = np.lexsort((pairs[:, 1], -count, pairs[:, 0]))
    first = np.unique(pairs[order, 0], return_index=True)[1]
    return np.asarray(pairs[order, 1][first], dtype=np.int64)


def _weighted_quantile(values: NDArray[np.float64], weights: NDArray[np.float64], share: float) -> float:
    """Return the smallest value that this share of the weight does not exceed; NaN of nothing."""
    if not len(values):
        return math.nan
    order = np.argsort(values)
    reached = np.cumsum(weights[order]) >= share * weights.sum() * (1 - 1e-12)
    return float(values[order][reached.argmax()])
