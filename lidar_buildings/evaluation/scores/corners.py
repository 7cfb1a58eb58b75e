"""How many corners of a reference were found, and how many of a result are some."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

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
    Match corners one to one, the nearest pair first, and count what is left on either side.

    Polygons are one a building, invalid ones are repaired; only corners inside an area count, where one is
    given. ValueError if the tolerance is not a positive number.
    """
    if not (math.isfinite(tolerance) and tolerance > 0):
        raise ValueError(f"tolerance = {tolerance}: must be a length above 0")
    limits = limits_of(area)
    corners = (corners_of(valid_polygons(side)) for side in (result, reference))
    mine, theirs = (own[within(own, limits)] for own in corners)
    distances = _matched_distances(mine, theirs, tolerance)
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


def _matched_distances(
    mine: NDArray[np.float64], theirs: NDArray[np.float64], tolerance: float
) -> NDArray[np.float64]:
    """Pair corners within the tolerance one to one, nearest first; return the distances of the pairs."""
    if not (len(mine) and len(theirs)):
        return np.empty(0)
    pairs = cKDTree(mine).sparse_distance_matrix(cKDTree(theirs), tolerance, output_type="ndarray")
    taken = np.zeros(len(mine), dtype=bool), np.zeros(len(theirs), dtype=bool)
    distances = []
    for one, other, distance in pairs[np.lexsort((pairs["j"], pairs["i"], pairs["v"]))]:
        if not (taken[0][one] or taken[1][other]):
            taken[0][one] = taken[1][other] = True
            distances.append(distance)
    return np.array(distances)
