"""Fewer corners: cells and faces take a neighbour's plane where what they explain is worth no corners."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.stages.building_model.arrangement import Cells
from lidar_buildings.core.stages.building_model.description import (
    grouped,
    length_of,
    plane_beside,
    sort_round,
)

#: Rounds over all cells and faces at most.
_MAX_ROUNDS = 20
#: Most cells that a plane spreads over, and what the description may get longer by meanwhile [corners].
_MOST_TOGETHER, _MOST_LONGER = 8, 8.0
#: A gain smaller than this is none [m³].
_EPSILON = 1e-9
#: What it costs to leave a face smaller than allowed as it is [m³].
_TOO_SMALL = 1e6


def simplified(
    cells: Cells,
    labels: IntArray,
    costs: FloatArray,
    planes: FloatArray,
    prices: tuple[float, float],
    min_area: float,
) -> IntArray:
    """
    Give cells and whole faces the plane of a neighbour wherever the description gets shorter.

    Its length is Σ misfit + the price of borders × their length + that of corners × their number. Corners
    are counted in space, as people draw them: where planes meet they are one, above a step and below it two.
    Cells are first tried alone; then one after the other beside those that took the plane before, as far as
    the description gets longer by little only, until it is shorter than at first (Kernighan & Lin, 1970): so
    borders move from one line to another beside it. Faces smaller than `min_area` go in any case.

    Parameters
    ----------
    cells : Cells
    labels : ndarray of shape (n_cells,), int64
        Row of each cell's plane.
    costs : ndarray of shape (n_cells, n_planes)
        Misfit of each plane over each cell [m³].
    planes : ndarray of shape (n_planes, 3)
        z = a·x + b·y + c.
    prices : tuple of float
        Of a metre of border [m²], and of a corner [m³].
    min_area : float
        [m²].
    """
    labels = labels.copy()
    if len(cells) > 1 and costs.shape[1] > 1:
        ends = cells.vertices[cells.borders]
        along = ends[:, 1] - ends[:, 0]
        turns = np.arctan2(along[:, 1], along[:, 0])
        length = np.hypot(along[:, 0], along[:, 1])
        courses = along / length[:, None]
        _simplify(
            cells.vertices, cells.borders, cells.sides, turns, courses, prices[0] * length, cells.areas,
            costs, planes, prices[1], min_area, labels,
        )  # fmt: skip
    return labels


@kernel
def _simplify(  # type: ignore[no-untyped-def]
    spots, borders, sides, turns, courses, prices, areas, costs, planes, corner_cost, min_area, labels
):
    n_cells, n_vertices = len(areas), len(spots)
    first, rows = grouped(borders, n_vertices)
    sort_round(first, rows, borders, turns)
    begin, around = grouped(sides, n_cells)
    heights = np.empty(len(borders) + 1)
    graph = (first, rows, begin, around, borders, sides, courses, prices, spots, planes, heights)
    members, vertices = np.empty(n_cells, np.int64), np.empty(n_vertices, np.int64)
    cell_mark, vertex_mark = np.zeros(n_cells, np.int64), np.zeros(n_vertices, np.int64)
    # When each cell was last looked at, alone and in its face, and when anything about it last changed.
    looked, changed = np.zeros((2, n_cells), np.int64), np.zeros(n_cells, np.int64)
    longer, stale = np.empty(n_cells), np.zeros(n_cells, np.int64)
    taken, member = np.empty(_MOST_TOGETHER, np.int64), np.empty(1, np.int64)
    tried, mark = np.zeros(costs.shape[1], np.int64), np.zeros(1, np.int64)
    work = (members, vertices, vertex_mark, cell_mark, stale, taken, member, tried)
    for most in (1, _MOST_TOGETHER):
        looked[0] = -1
        for _ in range(_MAX_ROUNDS):
            is_new = False
            for c in range(n_cells):
                if changed[c] < looked[0, c]:
                    continue
                mark[0] += 1
                looked[0, c] = mark[0]
                is_new |= _spread(c, most, mark, work, longer, changed, labels, costs, corner_cost, graph)
            face_mark = mark[0] + 1
            for c in range(n_cells):
                if cell_mark[c] >= face_mark:
                    continue
                mark[0] += 1
                n = _gather(c, mark[0], members, cell_mark, labels, graph)
                was_looked_at = True
                for i in range(n):
                    was_looked_at &= changed[members[i]] < looked[1, members[i]]
                    looked[1, members[i]] = mark[0]
                m = 0 if was_looked_at else _touch(members[:n], mark[0], vertices, vertex_mark, labels, graph)
                if m == 0:
                    continue
                area = 0.0
                for i in range(n):
                    area += areas[members[i]]
                least = _TOO_SMALL if area < min_area else -_EPSILON
                label = _best(
                    members[:n], vertices[:m], least, mark[0], tried, labels, costs, corner_cost, graph
                )
                if label >= 0:
                    is_new = True
                    for i in range(n):
                        labels[members[i]] = label
                    for i in range(m):
                        _note(vertices[i], mark[0], changed, graph)
            if not is_new:
                break


@inner_kernel
def _spread(start, most, mark, work, longer, changed, labels, costs, corner_cost, graph):  # type: ignore[no-untyped-def]
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
            if total >= bound and total > -_EPSILON:
                break
            m -= 1
            fringe[best], taken[n], labels[c] = fringe[m], c, label
            n += 1
            if total < -_EPSILON:
                for i in range(n):
                    for k in range(begin[taken[i]], begin[taken[i] + 1]):
                        for end in range(2):
                            _note(graph[4][around[k], end], mark[0], changed, graph)
                return True
            m = _widen(c, begun, m, fringe, seen, stale, own, labels, graph)
        for i in range(n):
            labels[taken[i]] = own
    return False


@inner_kernel
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


@inner_kernel
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


@inner_kernel
def _gather(c, mark, members, cell_mark, labels, graph):  # type: ignore[no-untyped-def]
    """Write the cells of a cell's face; return how many these are."""
    _, _, begin, around, _, sides, _, _, _, _, _ = graph
    members[0], cell_mark[c], n, done = c, mark, 1, 0
    while done < n:
        for k in range(begin[members[done]], begin[members[done] + 1]):
            for side in range(2):
                other = sides[around[k], side]
                if other >= 0 and labels[other] == labels[c] and cell_mark[other] != mark:
                    cell_mark[other], members[n] = mark, other
                    n += 1
        done += 1
    return n


@inner_kernel
def _touch(members, mark, vertices, vertex_mark, labels, graph):  # type: ignore[no-untyped-def]
    """Write the vertices at which a face ends; return how many."""
    _, _, begin, around, borders, sides, _, _, _, _, _ = graph
    n = 0
    for c in members:
        for k in range(begin[c], begin[c + 1]):
            e = around[k]
            for end in range(
                2 if plane_beside(e, 0, sides, labels) != plane_beside(e, 1, sides, labels) else 0
            ):
                v = borders[e, end]
                if vertex_mark[v] != mark:
                    vertex_mark[v], vertices[n] = mark, v
                    n += 1
    return n


@inner_kernel
def _note(v, mark, changed, graph):  # type: ignore[no-untyped-def]
    """Note for the cells round a vertex that one of them changed."""
    first, rows, _, _, _, sides, _, _, _, _, _ = graph
    for k in range(first[v], first[v + 1]):
        for side in range(2):
            if sides[rows[k], side] >= 0:
                changed[sides[rows[k], side]] = mark


@inner_kernel
def _best(members, vertices, least, mark, tried, labels, costs, corner_cost, graph):  # type: ignore[no-untyped-def]
    """Return the neighbours' plane that shortens the description most, by more than `least`; or -1."""
    _, _, begin, around, _, sides, _, _, _, _, _ = graph
    own = labels[members[0]]
    before = length_of(members, vertices, np.inf, labels, costs, corner_cost, graph)
    best, chosen = before + least, -1
    tried[own] = mark
    for c in members:
        for k in range(begin[c], begin[c + 1]):
            for side in range(2):
                other = sides[around[k], side]
                if other < 0 or tried[labels[other]] == mark:
                    continue
                label = labels[other]
                tried[label] = mark
                for i in members:
                    labels[i] = label
                length = length_of(members, vertices, best, labels, costs, corner_cost, graph)
                for i in members:
                    labels[i] = own
                if length < best:
                    best, chosen = length, label
    return chosen
