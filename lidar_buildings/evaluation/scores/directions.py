"""By which angle walls of a result differ from those of the reference that they stand for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.outline import ring_walls
from lidar_buildings.evaluation.scores.polygons import open_rings, simplified, spots_along, within
from lidar_buildings.evaluation.scores.statistics import ratio

#: Step between samples along a wall: finer than any point spacing resolves [m].
STEP = 0.25
#: A wall stands for a wall of the reference if at least half of it is no further away than this [m].
DEFAULT_REACH = 1.0


@dataclass(frozen=True)
class DirectionScore:
    """
    Angles between walls that belong together, every metre of wall with the same weight.

    `doc/scores.md` says what the figures are.
    """

    median_deg: float
    percentile_95_deg: float
    matched_share: float


def score_directions(
    result: NDArray[Any],
    reference: NDArray[Any],
    *,
    reach: float = DEFAULT_REACH,
    limits: shapely.Geometry | None = None,
) -> DirectionScore:
    """
    Compare the directions of walls, outline by outline; the rows are partners.

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
    return DirectionScore(
        median_deg=_weighted_quantile(angle[matched], length[matched], 0.5),
        percentile_95_deg=_weighted_quantile(angle[matched], length[matched], 0.95),
        matched_share=ratio(float(length[matched].sum()), float(length.sum())),
    )


def _walls(polygon: shapely.Geometry) -> NDArray[np.float64]:
    """Return the ends of all walls of one outline that have a length, shape (n_walls, 2, 2) [m]."""
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
