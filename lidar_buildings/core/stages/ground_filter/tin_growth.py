"""A TIN that grows: in each round the candidates join that fit the facets best (Axelsson 2000)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.surfaces.incremental_delaunay import insert_vertex, with_room
from lidar_buildings.core.surfaces.tin import corners_of, plane_elevation, plane_slope, walk
from lidar_buildings.core.surfaces.triangulation import build_tin

#: How often the terrain is extended to the frame while it grows.
EXTENSIONS = 2


class GrowthLimits(NamedTuple):
    """How far from its facet a candidate may be to join."""

    angle: float  #: largest angle at which it may be seen from the corners of a level facet [rad]
    slope_gain: float  #: by how much of a facet's own slope that angle grows
    distance: float  #: largest distance above the facet [m]


@dataclass(eq=False)
class TerrainGrowth:
    """A TIN and the candidates that may join it."""

    #: Which candidates it began with; the others wait, in their order, shape (n_candidates,).
    is_seed: NDArray[np.bool_]
    #: The seeds, the frame and the waiting candidates, relative to the TIN's origin, with room for all.
    mesh: Mesh
    n_triangles: int  #: how many of the mesh's triangles are in use
    #: Of each waiting candidate whether it has joined and in which triangle it was seen last.
    joined: NDArray[np.bool_]
    home: NDArray[np.int32]

    def copy(self) -> TerrainGrowth:
        """Return a terrain that can grow on without changing this one."""
        mesh = self.mesh
        mesh = mesh._replace(
            vertices=mesh.vertices.copy(), triangles=mesh.triangles.copy(), neighbours=mesh.neighbours.copy()
        )
        return replace(self, mesh=mesh, joined=self.joined.copy(), home=self.home.copy())

    def grow(self, limits: GrowthLimits, excluded: NDArray[np.bool_] | None = None) -> None:
        """Let candidates join until none is left that may; those `excluded` never may."""
        may_join = True if excluded is None else ~excluded[~self.is_seed]
        for _ in range(EXTENSIONS):
            _extend(self.mesh, self.n_triangles)
            rows = np.flatnonzero(~self.joined & may_join).astype(np.int32)
            self.n_triangles = join_in_rounds(
                self.mesh, self.n_triangles, tuple(limits), rows, self.home, self.joined
            )

    def insert(self, chosen: NDArray[np.bool_]) -> None:
        """Let the chosen candidates join, whatever the limits."""
        rows = np.flatnonzero(chosen[~self.is_seed] & ~self.joined)
        self.n_triangles = _insert_all(rows, self.mesh, self.n_triangles, self.joined, self.home)

    def height_and_slope(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Return every candidate's height above the terrain [m], and the terrain's slope there (rise over run).
        """
        height, slope = np.zeros(len(self.is_seed)), np.zeros(len(self.is_seed))
        rows = np.flatnonzero(~self.is_seed).astype(np.int32)
        for_row_blocks(lambda a, b: _heights(self.mesh, self.home, rows, height, slope, a, b), len(rows))
        return height, slope


def start_growth(
    candidates: NDArray[np.float64], is_seed: NDArray[np.bool_], extent: NDArray[np.float64]
) -> TerrainGrowth:
    """
    Triangulate the seeds, one at least; the other candidates wait.

    At most one candidate a place, in an order that puts neighbours together; `extent` is what the terrain has
    to cover.
    """
    start = build_tin(candidates[is_seed], extent)
    waiting = candidates[~is_seed] - [*start.origin, 0.0]
    vertices = np.vstack((start.vertices, waiting))
    room = len(start.triangles) + 2 * len(waiting)
    mesh = Mesh(
        vertices,
        with_room(start.triangles, room),
        with_room(start.neighbours, room),
        start.n_real,
        len(start.vertices),
        edge_gradients(start.vertices[: start.n_real], start.vertices[start.n_real :]),
    )
    joined, home = np.zeros(len(waiting), dtype=np.bool_), start.locate(candidates[~is_seed])
    return TerrainGrowth(is_seed, mesh, len(start.triangles), joined, home)


@kernel
def _insert_all(rows, mesh, n_triangles, joined, home):  # type: ignore[no-untyped-def]
    vertices, triangles, neighbours, _, n_start, _ = mesh
    for i in rows:
        p = n_start + i
        within = walk(vertices[p, 0], vertices[p, 1], home[i], vertices, triangles, neighbours)
        n_triangles = insert_vertex(p, within, n_triangles, vertices, triangles, neighbours)
        joined[i], home[i] = True, within
    return n_triangles


@kernel
def _heights(mesh, home, rows, height, slope, begin, end):  # type: ignore[no-untyped-def]
    vertices, triangles, neighbours, _, n_start, _ = mesh
    for i in range(begin, end):
        x, y, z = vertices[n_start + i, 0], vertices[n_start + i, 1], vertices[n_start + i, 2]
        here = walk(x, y, home[i], vertices, triangles, neighbours)
        a, b, c = corners_of(here, vertices, triangles)
        height[rows[i]] = z - plane_elevation(x, y, a, b, c)
        slope[rows[i]] = plane_slope(a, b, c)


class Mesh(NamedTuple):
    """A mesh that grows, its frame, and the candidates that wait."""

    #: Real ones, from `n_real` on the frame's, from `n_start` on the waiting candidates [m], shape
    #: (n_vertices, 3).
    vertices: NDArray[np.float64]
    #: See `incremental_delaunay`, shape (m, 3).
    triangles: NDArray[np.int32]
    neighbours: NDArray[np.int32]
    #: See `vertices`.
    n_real: int
    n_start: int
    gradient: NDArray[np.float64]  #: the terrain's slope at the frame, shape (n_start - n_real, 2)


class Waiting(NamedTuple):
    """The candidates that wait, in a list for each triangle."""

    #: Of each triangle the candidate in it that fits best, −1 where there is none, shape (m,).
    first: NDArray[np.int32]
    #: Of each candidate another one of the same triangle, −1 after the last, shape (n_candidates,).
    following: NDArray[np.int32]
    home: NDArray[np.int32]  #: the triangle in whose list a candidate is, or was last, shape (n_candidates,)
    score: NDArray[np.float64]  #: how well it fits there; see `candidate_score`, shape (n_candidates,)


def join_in_rounds(
    mesh: Mesh,
    n_triangles: int,
    limits: tuple[float, ...],
    rows: NDArray[np.int32],
    home: NDArray[np.int32],
    joined: NDArray[np.bool_],
) -> int:
    """
    Let candidates join, in each round the best one of each triangle, until none is left that may.

    `rows` are the candidates that may join, int32; `home`, a triangle near each candidate, and `joined` are
    kept up to date. The mesh is changed in place; its new number of triangles in use is returned.
    """
    waiting = Waiting(
        np.full(len(mesh.triangles), -1, dtype=np.int32), np.empty_like(home), home, np.empty(len(home))
    )
    # Those to evaluate: they have not been yet, or their triangle changed.
    pending, n_pending = rows.copy(), len(rows)
    while True:
        # In the candidates' order, which puts neighbours together.
        pending[:n_pending].sort()
        for_row_blocks(lambda a, b: _evaluate(mesh, limits, waiting, pending, a, b), n_pending)
        facets = np.sort(_enqueue(waiting, pending[:n_pending]))
        if len(facets) == 0:
            return n_triangles
        best = _take_best(waiting, facets)
        joined[best] = True
        n_triangles, n_pending = _insert(mesh, n_triangles, facets, best, waiting, pending)


@inner_kernel
def _release(triangle, waiting, pending, n_pending):  # type: ignore[no-untyped-def]
    """Empty a triangle's list into `pending`; return how many are there then."""
    i = waiting.first[triangle]
    waiting.first[triangle] = -1
    while i >= 0:
        pending[n_pending] = i
        n_pending += 1
        i = waiting.following[i]
    return n_pending


@kernel
def _evaluate(mesh, limits, waiting, pending, begin, end):  # type: ignore[no-untyped-def]
    """Update triangle and score of the pending candidates from `begin` to `end`."""
    vertices, triangles, neighbours, n_real, n_start, _ = mesh
    for k in range(begin, end):
        i = pending[k]
        p = n_start + i
        here = walk(vertices[p, 0], vertices[p, 1], waiting.home[i], vertices, triangles, neighbours)
        waiting.home[i] = here
        waiting.score[i] = candidate_score(p, here, vertices, n_real, n_start, triangles, neighbours, limits)


@kernel
def _enqueue(waiting, pending):  # type: ignore[no-untyped-def]
    """Put candidates into the lists of their triangles, the best first; return the triangles one may join."""
    facets, n_facets = np.empty(len(pending), dtype=np.int32), 0
    first, following, home, score = waiting
    for i in pending:
        head = first[home[i]]
        if score[i] < np.inf and (head < 0 or score[head] == np.inf):
            facets[n_facets] = home[i]
            n_facets += 1
        # Of equals the one that comes first in the candidates' order.
        if head < 0 or score[i] < score[head] or (score[i] == score[head] and i < head):
            first[home[i]], following[i] = i, head
        else:
            following[i], following[head] = following[head], i
    return facets[:n_facets]


@kernel
def _take_best(waiting, facets):  # type: ignore[no-untyped-def]
    best = np.empty_like(facets)
    for k in range(len(facets)):
        best[k] = waiting.first[facets[k]]
        waiting.first[facets[k]] = waiting.following[best[k]]
    return best


@kernel
def _insert(mesh, n_triangles, facets, best, waiting, pending):  # type: ignore[no-untyped-def]
    """Insert the best candidate of each facet; candidates of triangles that change become pending."""
    # Return the numbers of triangles and of pending candidates.
    vertices, triangles, neighbours, _, n_start, _ = mesh
    n_pending = 0
    for k in range(len(facets)):
        p = n_start + best[k]
        # Insertions of this round may have cut the point's triangle off this number.
        within = walk(vertices[p, 0], vertices[p, 1], facets[k], vertices, triangles, neighbours)
        n_triangles = insert_vertex(p, within, n_triangles, vertices, triangles, neighbours)
        waiting.home[best[k]] = within
        # What changed are the triangles round the new vertex, which is corner 0 of each.
        triangle = within
        while True:
            n_pending = _release(triangle, waiting, pending, n_pending)
            triangle = neighbours[triangle, 1]
            if triangle == within:
                break
    return n_triangles, n_pending


# Chosen with `bench.ground.isprs` and `bench.ground.scenes`; mirroring is Axelsson's (2000).
#: A facet is left as it is by points this close to it: they add nothing to its shape [m].
FLAT_DISTANCE = 0.05
#: Rise over run from which a facet may span a step of the terrain, so that points are tried mirrored as well.
MIRROR_SLOPE = 0.1


@kernel
def candidate_score(p, triangle, vertices, n_real, n_start, triangles, neighbours, limits):  # type: ignore[no-untyped-def]
    """
    Return how well a candidate, row p of `vertices`, fits the terrain, the less the better.

    Infinity where it may not join, neither as it is nor mirrored.
    """
    a, b, c = corners_of(triangle, vertices, triangles)
    point = vertices[p, 0], vertices[p, 1], vertices[p, 2]
    score = _facet_score(point, a, b, c, limits)
    if score == np.inf:
        score = _mirrored_score(p, triangle, vertices, n_real, n_start, triangles, neighbours, limits)
    return score


@kernel
def _facet_score(point, a, b, c, limits):  # type: ignore[no-untyped-def]
    """Return how well a point fits a facet; infinity where it may not join."""
    # Below the facet the distance to it, negative; above it the largest angle at a corner.
    angle, gain, distance = limits
    slope = plane_slope(a, b, c)
    above = (point[2] - plane_elevation(point[0], point[1], a, b, c)) / math.sqrt(1.0 + slope * slope)
    if above < -FLAT_DISTANCE:
        return above
    if above < FLAT_DISTANCE or above > distance:
        return np.inf
    seen_at = _angle_at_corners(point, a, b, c, above)
    return seen_at if seen_at <= angle or seen_at <= angle + gain * math.atan(slope) else np.inf


@kernel
def _mirrored_score(p, triangle, vertices, n_real, n_start, triangles, neighbours, limits):  # type: ignore[no-untyped-def]
    """Return how well a candidate, mirrored at its facet's nearest corner, fits the terrain there."""
    # Level ground that ends in a step reaches its edge in this way; a roof does not, as its corners are
    # ground.
    angle, _, distance = limits
    if plane_slope(*corners_of(triangle, vertices, triangles)) < MIRROR_SLOPE:
        return np.inf
    x, y, z = vertices[p, 0], vertices[p, 1], vertices[p, 2]
    corner = _nearest_corner(x, y, triangle, vertices, triangles)
    if n_real <= corner < n_start or abs(z - vertices[corner, 2]) > distance:
        return np.inf
    x, y = 2.0 * vertices[corner, 0] - x, 2.0 * vertices[corner, 1] - y
    there = walk(x, y, triangle, vertices, triangles, neighbours)
    if at_frame(there, triangles, n_real, n_start):
        return np.inf
    a, b, c = corners_of(there, vertices, triangles)
    off = abs(z - plane_elevation(x, y, a, b, c)) / math.hypot(1.0, plane_slope(a, b, c))
    if off > distance:
        return np.inf
    seen_at = _angle_at_corners((x, y, z), a, b, c, off)
    return seen_at if seen_at <= angle else np.inf


@kernel
def _angle_at_corners(point, a, b, c, off):  # type: ignore[no-untyped-def]
    """Return the largest angle between a facet and the lines from its corners to a point `off` it [rad]."""
    nearest = math.sqrt(min(_squared(point, a), _squared(point, b), _squared(point, c)))
    return math.asin(min(1.0, off / nearest)) if nearest > 0.0 else 0.0


@kernel
def _nearest_corner(x, y, triangle, vertices, triangles):  # type: ignore[no-untyped-def]
    nearest, least = triangles[triangle, 0], np.inf
    for k in range(3):
        v = triangles[triangle, k]
        away = (vertices[v, 0] - x) ** 2 + (vertices[v, 1] - y) ** 2
        if away < least:
            nearest, least = v, away
    return nearest


@inner_kernel
def _squared(p, q):  # type: ignore[no-untyped-def]
    return (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2


# Chosen with `bench.ground.isprs` and `bench.ground.scenes`.
#: Seeds that the slope at a virtual point is taken from.
NEIGHBOURS = 6
#: Added to the seeds' variance in plan as if it were level: slopes hold only where they reach [m²].
LEVEL_VARIANCE = 100.0


def edge_gradients(seeds: NDArray[np.float64], frame: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return the terrain's rise over run along x and y at each virtual point, from the seeds nearest to it.

    Least squares, damped so that seeds close together or on a line say nothing about where they do not reach.
    """
    k = min(NEIGHBOURS, len(seeds))
    _, nearest = cKDTree(seeds[:, :2]).query(frame[:, :2], [*range(1, k + 1)])
    around = seeds[nearest]
    around = around - around.mean(axis=1, keepdims=True)
    plan, rise = around[..., :2], around[..., 2:]
    normal = np.swapaxes(plan, 1, 2) @ plan + k * LEVEL_VARIANCE * np.eye(2)
    return np.linalg.solve(normal, np.swapaxes(plan, 1, 2) @ rise)[..., 0]


@inner_kernel
def at_frame(triangle, triangles, n_real, n_start):  # type: ignore[no-untyped-def]
    """Whether a triangle has a virtual corner: rows `n_real` to `n_start` are the virtual vertices."""
    a, b, c = triangles[triangle, 0], triangles[triangle, 1], triangles[triangle, 2]
    return n_real <= a < n_start or n_real <= b < n_start or n_real <= c < n_start


@kernel
def _extend(mesh, n_triangles):  # type: ignore[no-untyped-def]
    """Raise each virtual vertex to the slope beyond the nearest real one that it shares a triangle with."""
    vertices, triangles, _, n_real, n_start, gradient = mesh
    least = np.full(n_start - n_real, np.inf)
    for t in range(n_triangles):
        for v in triangles[t]:
            if not n_real <= v < n_start:
                continue
            for w in triangles[t]:
                dx, dy = vertices[v, 0] - vertices[w, 0], vertices[v, 1] - vertices[w, 1]
                away = dx * dx + dy * dy
                f = v - n_real
                if not n_real <= w < n_start and away < least[f]:
                    least[f] = away
                    vertices[v, 2] = vertices[w, 2] + gradient[f, 0] * dx + gradient[f, 1] * dy
