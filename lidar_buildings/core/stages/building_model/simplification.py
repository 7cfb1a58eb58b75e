"""Fewer corners: cells and faces take a neighbour's plane where what they explain is worth no corners."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.stages.building_model.arrangement import Cells

#: Edges that turn by less run straight on: sine of the angle.
_STRAIGHT = 0.02
#: Rounds over all cells and faces at most.
_MAX_ROUNDS = 20
#: A gain smaller than this is none [m³].
_EPSILON = 1e-9
#: What it costs to leave a face smaller than allowed as it is [m³].
_TOO_SMALL = 1e6


def simplified(
    cells: Cells, labels: IntArray, costs: FloatArray, border_cost: float, corner_cost: float, min_area: float
) -> IntArray:
    """
    Give single cells, then whole faces the plane of a neighbour wherever the description gets shorter.

    Its length is Σ misfit + `border_cost` × length of borders + `corner_cost` × corners of faces. Strips,
    teeth of seams and notches go where they explain less misfit than their corners cost, faces smaller
    than `min_area` in any case.

    Parameters
    ----------
    cells : Cells
    labels : ndarray of shape (n_cells,), int64
        Row of each cell's plane.
    costs : ndarray of shape (n_cells, n_planes)
        Misfit of each plane over each cell [m³].
    border_cost : float
        Of a metre of border [m²].
    corner_cost : float
        Of a corner of a face [m³].
    min_area : float
        [m²].
    """
    labels = labels.copy()
    if len(cells) > 1 and costs.shape[1] > 1:
        ends = cells.vertices[cells.borders]
        along = ends[:, 1] - ends[:, 0]
        turns = np.arctan2(along[:, 1], along[:, 0])
        length = np.hypot(along[:, 0], along[:, 1])
        courses, prices = along / length[:, None], border_cost * length
        n = len(cells.vertices)
        _simplify(
            n, cells.borders, cells.sides, turns, courses, prices, cells.areas, costs, corner_cost, min_area,
            labels,
        )  # fmt: skip
    return labels


@kernel
def _simplify(  # type: ignore[no-untyped-def]
    n_vertices, borders, sides, turns, courses, prices, areas, costs, corner_cost, min_area, labels
):
    n_cells = len(areas)
    first, rows = _grouped(borders, n_vertices)
    _sort_round(first, rows, borders, turns)
    begin, around = _grouped(sides, n_cells)
    graph = (first, rows, begin, around, borders, sides, courses, prices)
    members, vertices = np.empty(n_cells, np.int64), np.empty(n_vertices, np.int64)
    cell_mark, vertex_mark = np.zeros(n_cells, np.int64), np.zeros(n_vertices, np.int64)
    # When each cell was last looked at, alone and in its face, and when anything about it last changed.
    looked, changed = np.zeros((2, n_cells), np.int64), np.zeros(n_cells, np.int64)
    tried, mark, last_move = np.zeros(costs.shape[1], np.int64), 1, 1
    for _ in range(_MAX_ROUNDS):
        round_mark = mark
        for whole in range(2):
            face_mark = mark + 1
            for c in range(n_cells):
                if whole == 1 and cell_mark[c] >= face_mark:
                    continue
                mark += 1
                n = _gather(c, whole == 1, mark, members, cell_mark, labels, graph)
                is_new = False
                for i in range(n):
                    is_new = is_new or changed[members[i]] >= looked[whole, members[i]]
                    looked[whole, members[i]] = mark
                if not is_new:
                    continue
                m = _touch(members[:n], mark, vertices, vertex_mark, labels, graph)
                if m == 0:
                    continue
                area = 0.0
                for i in range(n):
                    area += areas[members[i]]
                least = _TOO_SMALL if whole == 1 and area < min_area else -_EPSILON
                label = _best(
                    members[:n], vertices[:m], least, mark, tried, labels, costs, corner_cost, graph
                )
                if label >= 0:
                    last_move = mark
                    for i in range(n):
                        labels[members[i]] = label
                    for i in range(m):
                        _note(vertices[i], mark, changed, graph)
        if last_move <= round_mark:
            break


@inner_kernel
def _grouped(owners, n):  # type: ignore[no-untyped-def]
    """Return where each owner's places begin, and the rows of `owners` by owner; -1 owns none."""
    first, rows = np.zeros(n + 1, np.int64), np.empty(owners.size, np.int64)
    for e in range(len(owners)):
        for side in range(2):
            if owners[e, side] >= 0:
                first[owners[e, side]] += 1
    for k in range(n):
        first[k + 1] += first[k]
    for e in range(len(owners) - 1, -1, -1):
        for side in range(2):
            if owners[e, side] >= 0:
                first[owners[e, side]] -= 1
                rows[first[owners[e, side]]] = e
    return first, rows


@inner_kernel
def _turn(e, v, borders, turns):  # type: ignore[no-untyped-def]
    """Direction in which an edge leaves a vertex [rad]."""
    return turns[e] if borders[e, 0] == v else turns[e] - math.copysign(math.pi, turns[e])


@inner_kernel
def _sort_round(first, rows, borders, turns):  # type: ignore[no-untyped-def]
    """Put the edges round each vertex in place by rising direction."""
    for v in range(len(first) - 1):
        for k in range(first[v] + 1, first[v + 1]):
            e, at = rows[k], k
            while at > first[v] and _turn(rows[at - 1], v, borders, turns) > _turn(e, v, borders, turns):
                rows[at] = rows[at - 1]
                at -= 1
            rows[at] = e


@inner_kernel
def _gather(c, whole, mark, members, cell_mark, labels, graph):  # type: ignore[no-untyped-def]
    """Write a cell, or all of its face; return how many cells these are."""
    _, _, begin, around, _, sides, _, _ = graph
    members[0], n, done = c, 1, 0
    if whole:
        cell_mark[c] = mark
    while whole and done < n:
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
    """Write the vertices of a cell or those at which a face ends; return how many, 0 amid a face."""
    _, _, begin, around, borders, sides, _, _ = graph
    n, is_amid = 0, True
    for c in members:
        for k in range(begin[c], begin[c + 1]):
            e = around[k]
            is_border = _face(e, 0, sides, labels) != _face(e, 1, sides, labels)
            is_amid = is_amid and not is_border
            if len(members) > 1 and not is_border:
                continue
            for end in range(2):
                v = borders[e, end]
                if vertex_mark[v] != mark:
                    vertex_mark[v], vertices[n] = mark, v
                    n += 1
    return 0 if is_amid else n


@inner_kernel
def _note(v, mark, changed, graph):  # type: ignore[no-untyped-def]
    """Note for the cells round a vertex that one of them changed."""
    first, rows, _, _, _, sides, _, _ = graph
    for k in range(first[v], first[v + 1]):
        for side in range(2):
            if sides[rows[k], side] >= 0:
                changed[sides[rows[k], side]] = mark


@inner_kernel
def _best(members, vertices, least, mark, tried, labels, costs, corner_cost, graph):  # type: ignore[no-untyped-def]
    """Return the neighbours' plane that shortens the description most, by more than `least`; or -1."""
    _, _, begin, around, _, sides, _, _ = graph
    own = labels[members[0]]
    before = _length(members, vertices, np.inf, labels, costs, corner_cost, graph)
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
                length = _length(members, vertices, best, labels, costs, corner_cost, graph)
                for i in members:
                    labels[i] = own
                if length < best:
                    best, chosen = length, label
    return chosen


@inner_kernel
def _length(members, vertices, most, labels, costs, corner_cost, graph):  # type: ignore[no-untyped-def]
    """Return what some cells, their edges and their vertices cost [m³], or a part that is `most` already."""
    first, rows, begin, around, borders, sides, courses, prices = graph
    total = 0.0
    for c in members:
        total += costs[c, labels[c]]
        for k in range(begin[c], begin[c + 1]):
            one, other = sides[around[k], 0], sides[around[k], 1]
            if one >= 0 and other >= 0 and labels[one] != labels[other]:
                total += prices[around[k]]
        if total >= most:
            return total
    for v in vertices:
        start, before = -1, -1
        for k in range(first[v], first[v + 1]):
            e = rows[k]
            if _face(e, 0, sides, labels) == _face(e, 1, sides, labels):
                continue
            if start < 0:
                start = e
            else:
                total += corner_cost * _turns_between(v, before, e, borders, sides, courses)
            before = e
        if before != start:
            total += corner_cost * _turns_between(v, before, start, borders, sides, courses)
    return total


@inner_kernel
def _face(e, side, sides, labels):  # type: ignore[no-untyped-def]
    """Plane on one side of an edge, -1 beside the outline."""
    return labels[sides[e, side]] if sides[e, side] >= 0 else -1


@inner_kernel
def _turns_between(v, one, other, borders, sides, courses):  # type: ignore[no-untyped-def]
    """1 if a face lies between two edges round a vertex and turns there, else 0."""
    # To the left of an edge that leaves the vertex lies what follows by rising direction.
    inside = sides[one, 0] if borders[one, 0] == v else sides[one, 1]
    is_straight = abs(courses[one, 0] * courses[other, 1] - courses[one, 1] * courses[other, 0]) < _STRAIGHT
    return 0.0 if inside < 0 or is_straight else 1.0
