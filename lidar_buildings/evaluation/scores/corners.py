"""How many corners of a reference were found, and how many of a result are some."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.evaluation.scores.polygons import (
    limits_of,
    open_rings,
    simplified,
    valid_polygons,
    within,
)
from lidar_buildings.evaluation.scores.statistics import mean, ratio

#: How far a corner may lie from the one that it stands for: two spacings of dense surveys, one of sparse [m].
DEFAULT_TOLERANCE = 1.0
#: A vertex that turns less is part of a curve or of a wall that is not quite straight [deg].
MIN_TURN_DEG = 10.0


@dataclass(frozen=True)
class CornerScore:
    """Agreement of corners, see `doc/scores.md`; a share of nothing is NaN."""

    n_result: int
    n_reference: int
    n_matched: int
    precision: float
    recall: float
    mean_distance: float


def score_corners(
    result: ArrayLike,
    reference: ArrayLike,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    area: ArrayLike | None = None,
) -> CornerScore:
    """
    Match corners one to one, as `match_corners` does, and count what is left on either side.

    Polygons are one a building, invalid ones are repaired; only corners inside an area count, where one is
    given. ValueError if the tolerance is not a positive number.
    """
    if not (math.isfinite(tolerance) and tolerance > 0):
        raise ValueError(f"tolerance = {tolerance}: must be a length above 0")
    limits = limits_of(area)
    corners = (corners_of(valid_polygons(side)) for side in (result, reference))
    mine, theirs = (own[within(own, limits)] for own in corners)
    _, _, distances = match_corners(mine, theirs, tolerance)
    return CornerScore(
        n_result=len(mine),
        n_reference=len(theirs),
        n_matched=len(distances),
        precision=ratio(len(distances), len(mine)),
        recall=ratio(len(distances), len(theirs)),
        mean_distance=mean(distances),
    )


def corners_of(polygons: NDArray[Any]) -> NDArray[np.float64]:
    """
    Return the vertices at which simplified valid outlines turn by more than ten degrees, ring after ring.

    Courtyards' corners included; where buildings touch, every one's own.
    """
    corners = [ring[_turns(ring) > math.radians(MIN_TURN_DEG)] for ring in open_rings(simplified(polygons))]
    return np.concatenate([*corners, np.empty((0, 2))])


def _turns(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return by how much an open ring turns at each vertex, to either side [rad]."""
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
