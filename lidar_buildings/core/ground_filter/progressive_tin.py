"""
Progressive TIN densification: a coarse terrain grows, round by round, by the points that lie near it.

"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.ground_filter.frame import edge_gradients, extend_terrain
from lidar_buildings.core.ground_filter.seeds import choose_seeds
from lidar_buildings.core.incremental_delaunay import insert_vertex, with_room
from lidar_buildings.core.tin import Tin, build_tin, plane_elevation, plane_slope, walk

#: A guard, never reached on real data: terrain climbs at least one candidate a round.
MAX_ROUNDS = 1000
#: A facet is left as it is by points this close to it: they add nothing to its shape [m].
FLAT_DISTANCE = 0.05
#: Rise over run from which a facet may span a step of the terrain, so that points are tried mirrored as well.
MIRROR_SLOPE = 0.1


def densify(candidates: NDArray[np.float64], extent: NDArray[np.float64], config: GroundFilterConfig) -> Tin:
    """
    Return the terrain that the candidates make up (Axelsson 2000, with the thresholds taken facet by facet).

    A candidate joins the TIN if its distance to its facet and the angles at which it is seen from the facet's
    corners stay within limits; the angle's limit grows with the facet's own slope, so that the data set it
    where the terrain is, and the rest of the tile has no say. Candidates below their facet always may join.
    On a facet that may span a step, a candidate too far above is mirrored at the facet's nearest corner and
    tested against the terrain there. Each round inserts one candidate a facet, the lowest below it or the one
    under the smallest angle, which keeps a single point on an object from pulling others after it.

    Parameters
    ----------
    candidates : ndarray of shape (n_candidates, 3)
        At most one per place, gross errors removed, in an order that puts neighbours together [m].
    extent : ndarray of shape (2, 2)
        Lower left and upper right corner of what the terrain has to cover [m].
    config : GroundFilterConfig
        Thresholds.

    Returns
    -------
    Tin

    Notes
    -----
    Only candidates whose facet changed are looked at again, so the time is near linear in their number.

    """
    is_seed = np.zeros(len(candidates), dtype=np.bool_)
    is_seed[choose_seeds(candidates, config.seed_cell, config.max_seed_rise)] = True
    start = build_tin(candidates[is_seed], extent)
    n_start, n_triangles = len(start.vertices), len(start.triangles)
    vertices = np.vstack((start.vertices, candidates[~is_seed] - [*start.origin, 0.0]))
    room = n_triangles + 2 * len(vertices)
    triangles, neighbours = with_room(start.triangles, room), with_room(start.neighbours, room)
    limits = (
        math.radians(config.iteration_angle),
        config.slope_gain,
        config.iteration_distance,
        config.min_facet_side**2,
    )
    gradient = edge_gradients(start.vertices[: start.n_real], start.vertices[start.n_real :])
    n_triangles = _grow(vertices, start.n_real, n_start, triangles, neighbours, n_triangles, gradient, limits)
    return replace(
        start, vertices=vertices, triangles=triangles[:n_triangles], neighbours=neighbours[:n_triangles]
    )


@njit(cache=True, nogil=True)
def _grow(  # type: ignore[no-untyped-def]
    vertices, n_real, n_start, triangles, neighbours, n_triangles, gradient, limits
):
    """
    Insert candidates, the rows of `vertices` from `n_start` on, until none is left that may join.

    Return the number of triangles. Rows from `n_real` to `n_start` are the frame's, with their `gradient`.
    `limits` are angle [rad], its gain with the slope, distance [m], and the square of the side below which a
    facet is left as it is [m²].

    """
    n_waiting = len(vertices) - n_start
    joined = np.zeros(n_waiting, dtype=np.bool_)
    home = np.zeros(n_waiting, dtype=np.int32)
    # The round in which a triangle last changed; those of the start count as changed before the first.
    changed = np.zeros(len(triangles), dtype=np.int32)
    best = np.full(len(triangles), -1, dtype=np.int32)
    best_score = np.empty(len(triangles))
    for turn in range(1, MAX_ROUNDS):
        extend_terrain(vertices, n_real, n_start, triangles[:n_triangles], gradient, changed, turn - 1)
        _propose(
            vertices,
            n_real,
            n_start,
            triangles,
            neighbours,
            limits,
            turn,
            changed,
            joined,
            home,
            best,
            best_score,
        )
        n_before = n_triangles
        for triangle in range(n_before):
            i = best[triangle]
            if i < 0:
                continue
            best[triangle], joined[i] = -1, True
            p = n_start + i
            # Insertions of this round may have cut the point's triangle off this number.
            within = walk(vertices[p, 0], vertices[p, 1], triangle, vertices, triangles, neighbours)
            n_triangles = insert_vertex(
                p, within, n_triangles, vertices, triangles, neighbours, changed, turn
            )
        if n_triangles == n_before:
            break
    return n_triangles


@njit(cache=True, nogil=True)
def _propose(  # type: ignore[no-untyped-def]
    vertices, n_real, n_start, triangles, neighbours, limits, turn, changed, joined, home, best, best_score
):
    """
    Find the best candidate of each triangle that changed in the last round.

    """
    here = 0
    for i in range(len(joined)):
        if joined[i] or changed[home[i]] < turn - 1:
            continue
        p = n_start + i
        here = walk(
            vertices[p, 0], vertices[p, 1], here if turn == 1 else home[i], vertices, triangles, neighbours
        )
        home[i] = here
        score = _score(vertices[p], vertices, triangles[here], limits)
        if score == np.inf:
            score = _mirrored_score(p, here, vertices, n_real, n_start, triangles, neighbours, limits)
        if score < np.inf and (best[here] < 0 or score < best_score[here]):
            best[here], best_score[here] = i, score


@njit(cache=True, nogil=True)
def _score(point, vertices, corners, limits):  # type: ignore[no-untyped-def]
    """
    Return how well a point fits a facet, the less the better; infinity where it may not join.

    Below the facet the distance to it, negative; above it the largest angle at a corner.

    """
    angle, gain, distance, squared_side = limits
    a, b, c = vertices[corners[0]], vertices[corners[1]], vertices[corners[2]]
    if _squared_longest_side(a, b, c) < squared_side:
        return np.inf
    slope = plane_slope(a, b, c)
    above = (point[2] - plane_elevation(point[0], point[1], a, b, c)) / math.hypot(1.0, slope)
    if above < -FLAT_DISTANCE:
        return above
    if above < FLAT_DISTANCE or above > distance:
        return np.inf
    seen_at = _angle_at_corners(point, a, b, c, above)
    return seen_at if seen_at <= angle + gain * math.atan(slope) else np.inf


@njit(cache=True, nogil=True)
def _mirrored_score(p, triangle, vertices, n_real, n_start, triangles, neighbours, limits):  # type: ignore[no-untyped-def]
    """
    Return how well a candidate, mirrored at its facet's nearest corner, fits the terrain there.

    Level ground that ends in a step reaches its edge in this way; a roof does not, as its corners are ground.

    """
    angle, _, distance, squared_side = limits
    corners = triangles[triangle]
    a, b, c = vertices[corners[0]], vertices[corners[1]], vertices[corners[2]]
    if plane_slope(a, b, c) < MIRROR_SLOPE or _squared_longest_side(a, b, c) < squared_side:
        return np.inf
    corner = _nearest_corner(vertices, p, corners)
    if n_real <= corner < n_start or abs(vertices[p, 2] - vertices[corner, 2]) > distance:
        return np.inf
    mirrored = 2.0 * vertices[corner] - vertices[p]
    mirrored[2] = vertices[p, 2]
    there = triangles[walk(mirrored[0], mirrored[1], triangle, vertices, triangles, neighbours)]
    for v in there:
        if n_real <= v < n_start:
            return np.inf
    a, b, c = vertices[there[0]], vertices[there[1]], vertices[there[2]]
    offset = mirrored[2] - plane_elevation(mirrored[0], mirrored[1], a, b, c)
    off = abs(offset) / math.hypot(1.0, plane_slope(a, b, c))
    seen_at = _angle_at_corners(mirrored, a, b, c, off)
    return seen_at if off <= distance and seen_at <= angle else np.inf


@njit(cache=True, nogil=True)
def _angle_at_corners(point, a, b, c, off):  # type: ignore[no-untyped-def]
    """
    Return the largest angle between a facet and the lines from its corners to a point `off` it [rad].

    """
    nearest = math.sqrt(min(_squared(point, a), _squared(point, b), _squared(point, c)))
    return math.asin(min(1.0, off / nearest)) if nearest > 0.0 else 0.0


@njit(cache=True, nogil=True)
def _nearest_corner(vertices, p, corners):  # type: ignore[no-untyped-def]
    """
    Return the corner nearest to vertex p in plan.

    """
    nearest, least = corners[0], np.inf
    for v in corners:
        away = (vertices[v, 0] - vertices[p, 0]) ** 2 + (vertices[v, 1] - vertices[p, 1]) ** 2
        if away < least:
            nearest, least = v, away
    return nearest


@njit(cache=True, nogil=True)
def _squared_longest_side(a, b, c):  # type: ignore[no-untyped-def]
    """
    Return the square of a triangle's longest side in plan [m²].

    """
    ab = (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2
    bc = (c[0] - b[0]) ** 2 + (c[1] - b[1]) ** 2
    ca = (a[0] - c[0]) ** 2 + (a[1] - c[1]) ** 2
    return max(ab, bc, ca)


@njit(cache=True, nogil=True)
def _squared(p, q):  # type: ignore[no-untyped-def]
    """
    Return the squared distance of two points in space [m²].

    """
    return (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2
