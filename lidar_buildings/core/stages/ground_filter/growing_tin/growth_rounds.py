"""
The rounds in which candidates join a TIN: each costs as much as there are candidates whose facet changed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.stages.ground_filter.growing_tin.facet_scores import candidate_score
from lidar_buildings.core.stages.ground_filter.growing_tin.frame import at_frame, extend_terrain
from lidar_buildings.core.surfaces.incremental_delaunay import insert_vertex
from lidar_buildings.core.surfaces.tin import walk


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

    Parameters
    ----------
    mesh, n_triangles
        Changed in place, and how many of its triangles are in use; the new number is returned.
    limits : tuple
        See `GrowthLimits`.
    rows : ndarray of shape (n_rows,), int32
        The candidates that may join.
    home, joined : ndarray of shape (n_candidates,), int32 and bool
        A triangle near each candidate, and whether it has joined; kept up to date.
    """
    waiting = Waiting(
        np.full(len(mesh.triangles), -1, dtype=np.int32), np.empty_like(home), home, np.empty(len(home))
    )
    # Those to evaluate: they have not been yet, or their triangle changed.
    pending, n_pending = rows.copy(), len(rows)
    border, fresh = np.zeros(0, dtype=np.int32), _at_frame(mesh, np.arange(n_triangles, dtype=np.int32))
    while True:
        if len(fresh):
            border = _at_frame(mesh, np.union1d(border, fresh))
            n_pending = _extend(mesh, border, waiting, pending, n_pending)
        # In the candidates' order, which puts neighbours together.
        pending[:n_pending].sort()
        for_row_blocks(lambda a, b: _evaluate(mesh, limits, waiting, pending, a, b), n_pending)
        facets = np.sort(_enqueue(waiting, pending[:n_pending]))
        if len(facets) == 0:
            break
        best = _take_best(waiting, facets)
        joined[best] = True
        n_triangles, n_pending, fresh = _insert(mesh, n_triangles, facets, best, waiting, pending)
    return n_triangles


def _at_frame(mesh: Mesh, triangles: NDArray[np.int32]) -> NDArray[np.int32]:
    corners = mesh.triangles[triangles]
    return triangles[((corners >= mesh.n_real) & (corners < mesh.n_start)).any(axis=1)]


@kernel
def _extend(mesh, border, waiting, pending, n_pending):  # type: ignore[no-untyped-def]
    """Carry the terrain on to the frame; candidates of triangles that move with it become pending."""
    vertices, triangles, _, n_real, n_start, gradient = mesh
    moved = extend_terrain(vertices, n_real, n_start, triangles, border, gradient)
    for triangle in border:
        for k in range(3):
            v = triangles[triangle, k]
            if n_real <= v < n_start and moved[v - n_real]:
                n_pending = _release(triangle, waiting, pending, n_pending)
    return n_pending


@kernel
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
    """
    Insert the best candidate of each facet; candidates of triangles that change become pending.

    Return the numbers of triangles and of pending candidates, and the triangles at the frame that changed.
    """
    vertices, triangles, neighbours, n_real, n_start, _ = mesh
    n_pending, n_fresh, fresh = 0, 0, np.empty(64, dtype=np.int32)
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
            if at_frame(triangle, triangles, n_real, n_start):
                if n_fresh == len(fresh):
                    longer = np.empty(2 * n_fresh, dtype=np.int32)
                    for i in range(n_fresh):
                        longer[i] = fresh[i]
                    fresh = longer
                fresh[n_fresh] = triangle
                n_fresh += 1
            triangle = neighbours[triangle, 1]
            if triangle == within:
                break
    return n_triangles, n_pending, fresh[:n_fresh]
