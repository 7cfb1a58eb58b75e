"""Where points are few: planes through a point that most of its neighbours lie on."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.stages.roof_selection.candidates import MAX_SLOPE_DEG, Candidates
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.smooth_patches.decks import is_deck

#: Neighbours that vote: two rings around a point on an even surface.
N_VOTERS = 12
#: Least sine of the angle between the two neighbours that span a plane with the point.
MIN_SINE = 0.4
#: Largest distance from a plane, in the cells in which areas are counted, two spacings: neighbours in foliage
#: differ in height as they lie apart, and so as few come near a plane by chance at any density.
DISTANCE_CELLS = 1.0 / 32.0
#: Mean votes, of twelve, around a point of a roof; and where returns are not known, so that nothing but
#: planes tells of foliage. Houses have 7 in the mean, crowns 1 to 3.
MIN_VOTES, MIN_VOTES_UNKNOWN = 4.25, 5.0


def find_voted_roofs(candidates: Candidates, config: RoofSelectionConfig) -> NDArray[np.bool_]:
    """
    Tell which points are roof, and no deck, by the planes that points around lie on, where points are few.

    One point's votes say little where faces hold few points; a crown has few votes as a whole. Everything
    raised is asked, whichever the return: what others of its pulse came after has no votes, and foliage has
    many of those. `max_roughness` is the largest distance from the plane, if that is not narrower still.
    """
    points, n = candidates.points, len(candidates.points)
    votes = np.zeros(n, dtype=np.int64)
    distance = min(config.max_roughness, DISTANCE_CELLS * candidates.cell)
    votes[candidates.is_last] = plane_votes(points[candidates.is_last], distance)
    least = MIN_VOTES_UNKNOWN if candidates.is_only.all() else MIN_VOTES
    rows = np.flatnonzero(_mean_around(points[:, :2], votes) >= least)
    label, n_parts = candidates.parts(rows, candidates.radius)
    part, roof = label[rows], np.zeros(n, dtype=bool)
    decks = is_deck(points[rows], part, n_parts, candidates.ground(), candidates.cell)
    roof[rows[~decks[part]]] = True
    return roof


def plane_votes(points: NDArray[np.float64], max_distance: float) -> NDArray[np.int64]:
    """Return how many of each point's nearest neighbours lie on one plane through it: 0 to `N_VOTERS`."""
    votes = np.zeros(len(points), dtype=np.int64)
    if len(points) <= N_VOTERS:
        return votes
    near = cKDTree(points).query(points, N_VOTERS + 1)[1]
    least = math.cos(math.radians(MAX_SLOPE_DEG))
    for_row_blocks(lambda a, b: _vote(points, near, max_distance, least, votes, a, b), len(points))
    return votes


def _mean_around(plan: NDArray[np.float64], votes: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the mean votes of each point and its nearest neighbours in plan."""
    if len(plan) <= N_VOTERS:
        return votes.astype(np.float64)
    return np.asarray(votes[cKDTree(plan).query(plan, N_VOTERS + 1)[1]].mean(axis=1))


@kernel
def _vote(points, near, max_distance, min_upward, votes, begin, end):  # type: ignore[no-untyped-def]
    away = np.empty((near.shape[1], 3))
    for i in range(begin, end):
        for k in range(near.shape[1]):
            for axis in range(3):
                away[k, axis] = points[near[i, k], axis] - points[i, axis]
        for a in range(1, len(away)):
            for b in range(a + 1, len(away)):
                (ax, ay, az), (bx, by, bz) = away[a], away[b]
                x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
                length = math.sqrt(x * x + y * y + z * z)
                spans = (ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz)
                if length <= MIN_SINE * math.sqrt(spans) or abs(z) < min_upward * length:
                    continue
                found = -1
                for k in range(len(away)):
                    off = x * away[k, 0] + y * away[k, 1] + z * away[k, 2]
                    found += abs(off) <= max_distance * length
                votes[i] = max(votes[i], found)
