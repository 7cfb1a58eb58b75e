"""
Progressive TIN densification: a coarse terrain grows, round by round, by the points that lie near it.

"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.incremental_delaunay import insert_vertex, with_room
from lidar_buildings.core.point_order import lowest_per_cell
from lidar_buildings.core.tin import build_tin, walk

#: A guard, never reached on real data: terrain climbs at least one candidate a round.
MAX_ROUNDS = 1000
#: A facet is left as it is by points this close to it: they add nothing to its shape [m].
FLAT_DISTANCE = 0.05


def densify(candidates: NDArray[np.float64], config: GroundFilterConfig) -> NDArray[np.bool_]:
    """
    Return which candidates make up the terrain (Axelsson 2000, with the thresholds taken facet by facet).

    A candidate joins the TIN if its distance to its facet and the angles at which it is seen from the facet's
    corners stay within limits; the angle's limit grows with the facet's own slope, so that the data set it
    where the terrain is, and the rest of the tile has no say. Candidates below their facet always may join.
    Each round inserts one candidate a facet, the lowest below it or the one under the smallest angle, which
    keeps a single point on an object from pulling others after it.

    Parameters
    ----------
    candidates : ndarray of shape (n_candidates, 3)
        At most one per place, gross errors removed, in an order that puts neighbours together [m].
    config : GroundFilterConfig
        Thresholds.

    Returns
    -------
    ndarray of shape (n_candidates,), bool

    Notes
    -----
    Only candidates whose facet changed are looked at again, so the time is near linear in their number.

    """
    in_terrain = np.zeros(len(candidates), dtype=np.bool_)
    in_terrain[lowest_per_cell(candidates, config.largest_building)] = True
    extent = np.array([candidates.min(axis=0)[:2], candidates.max(axis=0)[:2]])
    start = build_tin(candidates[in_terrain], extent)
    waiting = np.flatnonzero(~in_terrain)
    n_vertices = len(start.vertices)
    vertices = np.vstack((start.vertices, candidates[waiting] - [*start.origin, 0.0]))
    joined = _grow(
        vertices,
        n_vertices,
        start.n_real,
        with_room(start.triangles, len(start.triangles) + 2 * len(waiting)),
        with_room(start.neighbours, len(start.triangles) + 2 * len(waiting)),
        len(start.triangles),
        math.radians(config.iteration_angle),
        config.slope_gain,
        config.iteration_distance,
        config.min_facet_side**2,
    )
    in_terrain[waiting] = joined
    return in_terrain


@njit(cache=True, nogil=True)
def _grow(  # type: ignore[no-untyped-def]
    vertices, n_start, n_real, triangles, neighbours, n_triangles, angle, gain, distance, squared_side
):
    """
    Insert candidates until none is left that may join; they are the rows of `vertices` from `n_start` on.

    """
    n_waiting = len(vertices) - n_start
    joined = np.zeros(n_waiting, dtype=np.bool_)
    home = np.zeros(n_waiting, dtype=np.int32)
    changed = np.zeros(len(triangles), dtype=np.int32)
    best = np.full(len(triangles), -1, dtype=np.int32)
    best_score = np.empty(len(triangles))
    for turn in range(1, MAX_ROUNDS):
        _follow(vertices, n_start, n_real, triangles, n_triangles, changed, turn)
        start = 0
        for i in range(n_waiting):
            if joined[i] or (turn > 1 and changed[home[i]] < turn - 1):
                continue
            x, y = vertices[n_start + i, 0], vertices[n_start + i, 1]
            start = walk(x, y, start if turn == 1 else home[i], vertices, triangles, neighbours)
            home[i] = start
            score = _score(vertices, triangles[start], n_start + i, angle, gain, distance, squared_side)
            if score < np.inf and (best[start] < 0 or score < best_score[start]):
                best[start], best_score[start] = i, score
        n_before = n_triangles
        for triangle in range(n_before):
            i = best[triangle]
            if i < 0:
                continue
            best[triangle], joined[i] = -1, True
            x, y = vertices[n_start + i, 0], vertices[n_start + i, 1]
            home[i] = walk(x, y, triangle, vertices, triangles, neighbours)
            n_triangles = insert_vertex(
                n_start + i, home[i], n_triangles, vertices, triangles, neighbours, changed, turn
            )
        if n_triangles == n_before:
            break
    return joined


@njit(cache=True, nogil=True)
def _score(vertices, corners, p, angle, gain, distance, squared_side):  # type: ignore[no-untyped-def]
    """
    Return how well a point fits a facet, the less the better; infinity where it may not join.

    Below the facet the distance to it, negative; above it the largest angle at a corner.

    """
    a, b, c = vertices[corners[0]], vertices[corners[1]], vertices[corners[2]]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    longest = max(ux * ux + uy * uy, vx * vx + vy * vy, (vx - ux) ** 2 + (vy - uy) ** 2)
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    if longest < squared_side or nz <= 0.0:
        return np.inf
    x, y, z = vertices[p, 0], vertices[p, 1], vertices[p, 2]
    norm = math.sqrt(nx * nx + ny * ny + nz * nz)
    above = ((x - a[0]) * nx + (y - a[1]) * ny + (z - a[2]) * nz) / norm
    if above < -FLAT_DISTANCE:
        return above
    if above < FLAT_DISTANCE or above > distance:
        return np.inf
    nearest = min(_squared(vertices[p], a), _squared(vertices[p], b), _squared(vertices[p], c))
    seen_at = math.asin(min(1.0, above / math.sqrt(nearest)))
    slope = math.acos(min(1.0, nz / norm))
    return seen_at if seen_at <= angle + gain * slope else np.inf


@njit(cache=True, nogil=True)
def _squared(p, q):  # type: ignore[no-untyped-def]
    """
    Return the squared distance of two points in space [m²].

    """
    return (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2


@njit(cache=True, nogil=True)
def _follow(vertices, n_start, n_real, triangles, n_triangles, changed, turn):  # type: ignore[no-untyped-def]
    """
    Give each virtual vertex of the frame the elevation of the nearest real one that it shares a triangle with.

    """
    nearest = np.full(n_start - n_real, np.inf)
    elevation = vertices[n_real:n_start, 2].copy()
    for t in range(n_triangles):
        for k in range(3):
            f = triangles[t, k] - n_real
            if f < 0 or f >= n_start - n_real:
                continue
            for m in range(3):
                v = triangles[t, m]
                if n_real <= v < n_start:
                    continue
                away = (vertices[v, 0] - vertices[f + n_real, 0]) ** 2 + (
                    vertices[v, 1] - vertices[f + n_real, 1]
                ) ** 2
                if away < nearest[f]:
                    nearest[f], elevation[f] = away, vertices[v, 2]
    for t in range(n_triangles):
        for k in range(3):
            f = triangles[t, k] - n_real
            if 0 <= f < n_start - n_real and elevation[f] != vertices[f + n_real, 2]:
                changed[t] = turn - 1
    vertices[n_real:n_start, 2] = elevation
