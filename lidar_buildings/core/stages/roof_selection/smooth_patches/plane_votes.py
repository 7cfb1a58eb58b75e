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
from lidar_buildings.core.stages.roof_selection.smooth_patches.roof_patches import RoofSurface

#: Neighbours that vote: two rings around a point on an even surface.
N_VOTERS = 12
#: Least sine of the angle between the two neighbours that span a plane with the point.
MIN_SINE = 0.4
#: Largest distance from a plane, in the cells in which areas are counted, two spacings: neighbours in foliage
#: differ in height as they lie apart, and so as few come near a plane by chance at any density.
DISTANCE_CELLS = 1.0 / 32.0
#: Points, of all that came back, that say whether one of them is roof: three rings around it.
N_AROUND = 24
#: What ground counts for among them, in votes: less than roofs, which have 7 in the mean, like crowns,
#: which have 1 to 3 and let ground be seen; so what is narrow or stands alone has to be flatter.
GROUND_VOTES = 1.75
#: Mean votes around a point of a roof; and where returns are not known, so that nothing but planes tells of
#: foliage.
MIN_VOTES, MIN_VOTES_UNKNOWN = 3.5, 4.15
#: How many more a connected roof has somewhere: in crowns few points at a time lie on a plane by chance.
MORE_VOTES = 1.0


def find_voted_surface(candidates: Candidates, config: RoofSelectionConfig) -> RoofSurface:
    """
    Find the planes of roofs, and of no deck, that points around lie on, where points are few.

    One point's votes say little where faces hold few points; a crown has few votes as a whole. All that came
    back around it is asked: what others of its pulse came after has no votes, and foliage has many of those;
    it lets ground be seen, too. Connected roof is surer somewhere. Where more of what is raised around a
    point has no such planes than has, no roof grows to it. `max_roughness` is the largest distance from the
    plane, if that is not narrower still.
    """
    points, n, ground = candidates.points, len(candidates.points), candidates.ground()
    votes, normals = np.zeros(n, dtype=np.int64), np.zeros((n, 3))
    distance = min(config.max_roughness, DISTANCE_CELLS * candidates.cell)
    votes[candidates.is_last], normals[candidates.is_last] = plane_votes(points[candidates.is_last], distance)
    least = MIN_VOTES_UNKNOWN if candidates.is_only.all() else MIN_VOTES
    mean = _mean_around(points[:, :2], votes, ground[:, :2], GROUND_VOTES)
    rows = np.flatnonzero(mean >= least)
    label, n_parts = candidates.parts(rows, candidates.radius)
    part, (is_surface, nothing) = label[rows], np.zeros((2, n), dtype=bool)
    decks = is_deck(points[rows], part, n_parts, ground, candidates.cell)
    most = np.zeros(n_parts)
    np.maximum.at(most, part, mean[rows])
    is_surface[rows] = (~decks & (most >= least + MORE_VOTES))[part] & (votes[rows] > 0)
    is_among_others = _mean_around(points, np.where(is_surface, 1, -1), ground, 0) <= 0.0
    return RoofSurface(is_surface, is_among_others & ~is_surface, nothing, normals[is_surface])


def plane_votes(
    points: NDArray[np.float64], max_distance: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """
    Return how many of each point's nearest neighbours lie on one plane through it: 0 to `N_VOTERS`.

    And the plane's unit normal, zero where there is none, shape (n_points, 3).
    """
    votes, normals = np.zeros(len(points), dtype=np.int64), np.zeros((len(points), 3))
    if len(points) > N_VOTERS:
        near, least = cKDTree(points).query(points, N_VOTERS + 1)[1], math.cos(math.radians(MAX_SLOPE_DEG))
        for_row_blocks(
            lambda *run: _vote(points, near, max_distance, least, votes, normals, *run), len(points)
        )
    return votes, normals


def _mean_around(
    points: NDArray[np.float64], values: NDArray[np.int64], ground: NDArray[np.float64], of_ground: float
) -> NDArray[np.float64]:
    """Return the mean value of each point and its nearest neighbours, in plan or space, ground among them."""
    # In an order of their own: of neighbours as far away the first ones count.
    every = np.vstack([points, ground[np.lexsort(ground.T)]])
    value = np.append(values, np.full(len(ground), of_ground))
    if len(every) <= N_AROUND:
        return value[: len(points)]
    return np.asarray(value[cKDTree(every).query(points, N_AROUND + 1)[1]].mean(axis=1))


@kernel
def _vote(points, near, max_distance, min_upward, votes, normals, begin, end):  # type: ignore[no-untyped-def]
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
                if found > votes[i]:
                    votes[i] = found
                    normals[i, 0], normals[i, 1], normals[i, 2] = x / length, y / length, z / length
