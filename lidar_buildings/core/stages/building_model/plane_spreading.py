"""Planes that spread cell by cell, though the description gets longer meanwhile, if it ends up shorter."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.stages.building_model.description import length_of, plane_beside

#: What the description may get longer by meanwhile [corners].
_MOST_LONGER = 8.0
#: A gain smaller than this is none [m³].
EPSILON = 1e-9


@kernel
def spread(start, most, mark, work, longer, changed, labels, costs, corner_cost, graph):  # type: ignore[no-untyped-def]
    """Let the plane of a neighbour spread from a cell; return whether that shortens the description."""
    _, _, begin, around, _, sides, _, _, _, _, _ = graph
    fringe, vertices, vertex_mark, seen, stale, taken, member, tried = work
    own, bound = labels[start], _MOST_LONGER * corner_cost if most > 1 else 0.0
    visit = mark[0]
    tried[own] = visit
    for at in range(begin[start], begin[start + 1]):
        label = plane_beside(around[at], 0 if sides[around[at], 0] != start else 1, sides, labels)
        if label < 0 or tried[label] == visit:
            continue
        tried[label] = visit
        mark[0] += 1
        begun, n, m, total = mark[0], 0, 1, 0.0
        fringe[0], seen[start], stale[start] = start, begun, begun
        while m > 0 and n < most:
            best = 0
            for i in range(m):
                c = fringe[i]
                if stale[c] >= 0:
                    mark[0] += 1
                    member[0] = c
                    longer[c] = _longer(
                        member,
                        label,
                        bound,
                        mark[0],
                        vertices,
                        vertex_mark,
                        labels,
                        costs,
                        corner_cost,
                        graph,
                    )
                    stale[c] = -1
                if longer[c] < longer[fringe[best]]:
                    best = i
            c = fringe[best]
            total += longer[c]
            if total >= bound and total > -EPSILON:
                break
            m -= 1
            fringe[best], taken[n], labels[c] = fringe[m], c, label
            n += 1
            if total < -EPSILON:
                for i in range(n):
                    for k in range(begin[taken[i]], begin[taken[i] + 1]):
                        for end in range(2):
                            note(graph[4][around[k], end], mark[0], changed, graph)
                return True
            m = _widen(c, begun, m, fringe, seen, stale, own, labels, graph)
        for i in range(n):
            labels[taken[i]] = own
    return False


@kernel
def _widen(c, begun, m, fringe, seen, stale, own, labels, graph):  # type: ignore[no-untyped-def]
    """Add a cell's neighbours of a plane to the fringe; what lies round its vertices is to be looked at."""
    first, rows, begin, around, borders, sides, _, _, _, _, _ = graph
    for k in range(begin[c], begin[c + 1]):
        for side in range(2):
            other = sides[around[k], side]
            if other >= 0 and labels[other] == own and seen[other] != begun:
                fringe[m], seen[other] = other, begun
                m += 1
            v = borders[around[k], side]
            for e in rows[first[v] : first[v + 1]]:
                for s in range(2):
                    if sides[e, s] >= 0:
                        stale[sides[e, s]] = begun
    return m


@kernel
def _longer(member, label, most, mark, vertices, vertex_mark, labels, costs, corner_cost, graph):  # type: ignore[no-untyped-def]
    """Return by how much a cell with another plane makes the description longer, or `most` and more [m³]."""
    _, _, begin, around, borders, _, _, _, _, _, _ = graph
    n, c = 0, member[0]
    own = labels[c]
    for k in range(begin[c], begin[c + 1]):
        for end in range(2):
            v = borders[around[k], end]
            if vertex_mark[v] != mark:
                vertex_mark[v], vertices[n] = mark, v
                n += 1
    before = length_of(member, vertices[:n], np.inf, labels, costs, corner_cost, graph)
    labels[c] = label
    after = length_of(member, vertices[:n], before + most, labels, costs, corner_cost, graph)
    labels[c] = own
    return after - before


@kernel
def note(v, mark, changed, graph):  # type: ignore[no-untyped-def]
    """Note for the cells round a vertex that one of them changed."""
    first, rows, _, _, _, sides, _, _, _, _, _ = graph
    for k in range(first[v], first[v + 1]):
        for side in range(2):
            if sides[rows[k], side] >= 0:
                changed[sides[rows[k], side]] = mark
