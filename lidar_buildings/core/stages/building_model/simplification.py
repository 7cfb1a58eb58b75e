"""Fewer corners: cells and faces take a neighbour's plane where the description of the roof gets shorter."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.few_rows import rows_by_group
from lidar_buildings.core.stages.building_model.cells import Cells

#: Edges that turn by less run straight on: sine of the angle.
STRAIGHT = 0.02
#: Corners of faces at one place are one corner if their elevations differ by less [m].
ONE_CORNER = 0.02


@kernel
def grouped(owners, n):  # type: ignore[no-untyped-def]
    """Return where each owner's places begin, and the rows of `owners` by owner; -1 owns none."""
    group = np.empty(2 * len(owners), dtype=owners.dtype)
    for row in range(len(owners)):
        for side in range(2):
            owner = owners[row, side]
            group[2 * row + side] = owner if owner >= 0 else n
    places, first = rows_by_group(group, n + 1)
    for k in range(len(places)):
        places[k] >>= 1
    return first, places


@inner_kernel
def _turn(e, v, borders, turns):  # type: ignore[no-untyped-def]
    """Direction in which an edge leaves a vertex [rad]."""
    return turns[e] if borders[e, 0] == v else turns[e] - math.copysign(math.pi, turns[e])


@kernel
def sort_round(first, rows, borders, turns):  # type: ignore[no-untyped-def]
    """Put the edges round each vertex in place by rising direction."""
    for v in range(len(first) - 1):
        for k in range(first[v] + 1, first[v + 1]):
            e, at = rows[k], k
            while at > first[v] and _turn(rows[at - 1], v, borders, turns) > _turn(e, v, borders, turns):
                rows[at] = rows[at - 1]
                at -= 1
            rows[at] = e


@kernel
def length_of(members, vertices, most, labels, costs, corner_cost, graph):  # type: ignore[no-untyped-def]
    """Return what some cells, their edges and their vertices cost [m³], or a part that is `most` already."""
    first, rows, begin, around, _, sides, _, prices, _, _, _ = graph
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
        start, before, n = np.int64(-1), np.int64(-1), np.int64(0)
        for k in range(first[v], first[v + 1]):
            e = rows[k]
            if plane_of(sides[e, 0], labels) == plane_of(sides[e, 1], labels):
                continue
            if start < 0:
                start = e
            else:
                n = _corners(v, before, e, n, labels, graph)
            before = e
        if before != start:
            n = _corners(v, before, start, n, labels, graph)
        total += corner_cost * n
    return total


@inner_kernel
def plane_of(cell, labels):  # type: ignore[no-untyped-def]
    """Plane of a cell, −1 beyond the outline."""
    return labels[cell] if cell >= 0 else -1


@kernel
def _corners(v, one, other, n, labels, graph):  # type: ignore[no-untyped-def]
    """Return the number of corners at a vertex, with that of the face between two edges if it turns there."""
    _, _, _, _, borders, sides, courses, _, spots, planes, heights = graph
    # To the left of an edge that leaves the vertex lies what follows by rising direction.
    inside = sides[one, 0] if borders[one, 0] == v else sides[one, 1]
    is_straight = abs(courses[one, 0] * courses[other, 1] - courses[one, 1] * courses[other, 0]) < STRAIGHT
    if inside < 0 or is_straight:
        return n
    p = labels[inside]
    heights[n] = planes[p, 0] * spots[v, 0] + planes[p, 1] * spots[v, 1] + planes[p, 2]
    for k in range(n):
        if abs(heights[k] - heights[n]) < ONE_CORNER:
            return n
    return n + 1


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
        e = around[at]
        label = plane_of(sides[e, 0] if sides[e, 0] != start else sides[e, 1], labels)
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


#: Rounds over all cells and faces at most.
_MAX_ROUNDS = 20
#: Most cells that a plane spreads over.
_MOST_TOGETHER = 8
#: Corners of a face by itself at least, those above its steps and those below.
_FEWEST_CORNERS = 8
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
    borders move from one line to another beside it. Faces smaller than `min_area` go in any case. Then every
    plane takes, at once, cells that hang together and that it fits no worse than theirs; all are tried again,
    and what is shorter is kept.

    - `labels`, shape (n_cells,), int64: Row of each cell's plane.
    - `costs`, shape (n_cells, n_planes): Misfit of each plane over each cell [m³].
    - `planes`, shape (n_planes, 3): z = a·x + b·y + c.
    - `prices`, tuple of float: Of a metre of border [m²], and of a corner [m³].
    - `min_area`: [m²].
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
    # When each cell was last looked at, alone, with others and in its face, and when anything about it last
    # changed.
    looked, changed = np.full((3, n_cells), -1, np.int64), np.zeros(n_cells, np.int64)
    longer, stale = np.empty(n_cells), np.zeros(n_cells, np.int64)
    taken, member = np.empty(_MOST_TOGETHER, np.int64), np.empty(1, np.int64)
    tried, mark = np.zeros(costs.shape[1], np.int64), np.zeros(1, np.int64)
    work = (members, vertices, vertex_mark, cell_mark, stale, taken, member, tried)
    known = (mark, work, longer, looked, changed, areas, min_area)
    _search(known, labels, costs, corner_cost, graph)
    best, shortest, is_new = labels.copy(), _length(labels, costs, corner_cost, graph), True
    settled, gathered, asked = changed.copy(), np.zeros(n_cells, np.int64), np.full(len(tried), -1, np.int64)
    while is_new:
        is_new = False
        for label in range(costs.shape[1]):
            visit = mark[0] + 1
            last, asked[label] = asked[label], visit
            for c in range(n_cells):
                if gathered[c] >= visit or not costs[c, label] < costs[c, labels[c]]:
                    continue
                mark[0] += 1
                n, gain = _gather(c, label, mark[0], members, gathered, labels, costs, graph)
                # Nor is asked again where nothing has changed.
                if gain <= _FEWEST_CORNERS * corner_cost or changed[members[:n]].max() < last:
                    continue
                for i in range(n):
                    labels[members[i]] = label
                    for k in range(begin[members[i]], begin[members[i] + 1]):
                        note(borders[around[k], 0], mark[0], changed, graph)
                        note(borders[around[k], 1], mark[0], changed, graph)
                _search(known, labels, costs, corner_cost, graph)
                length = _length(labels, costs, corner_cost, graph)
                if length < shortest - EPSILON:
                    best[:], settled[:], shortest, is_new = labels, changed, length, True
                labels[:], changed[:] = best, settled


@kernel
def _length(labels, costs, corner_cost, graph):  # type: ignore[no-untyped-def]
    """Return the length of the whole description [m³]."""
    first, _, _, _, _, sides, _, prices, _, _, _ = graph
    none = np.empty(0, np.int64)
    total = length_of(none, np.arange(len(first) - 1), np.inf, labels, costs, corner_cost, graph)
    for c in range(len(labels)):
        total += costs[c, labels[c]]
    for e in range(len(sides)):
        if min(sides[e, 0], sides[e, 1]) >= 0 and labels[sides[e, 0]] != labels[sides[e, 1]]:
            total += prices[e]
    return total


@kernel
def _search(known, labels, costs, corner_cost, graph):  # type: ignore[no-untyped-def]
    """Shorten the description by cells and faces that changed, and what lies round them."""
    mark, work, longer, looked, changed, areas, min_area = known
    members, vertices, vertex_mark, cell_mark, _, _, _, tried = work
    n_cells = len(labels)
    for together in range(2):
        most = _MOST_TOGETHER if together else 1
        for _ in range(_MAX_ROUNDS):
            is_new = False
            for c in range(n_cells):
                if changed[c] < looked[together, c]:
                    continue
                mark[0] += 1
                looked[together, c] = mark[0]
                is_new |= spread(c, most, mark, work, longer, changed, labels, costs, corner_cost, graph)
            face_mark = mark[0] + 1
            for c in range(n_cells):
                if cell_mark[c] >= face_mark or changed[c] < looked[2, c]:
                    continue
                mark[0] += 1
                n, _ = _gather(c, labels[c], mark[0], members, cell_mark, labels, costs, graph)
                for i in range(n):
                    looked[2, members[i]] = mark[0]
                m = _touch(members[:n], mark[0], vertices, vertex_mark, labels, graph)
                if m == 0:
                    continue
                area = 0.0
                for i in range(n):
                    area += areas[members[i]]
                least = _TOO_SMALL if area < min_area else -EPSILON
                label = _best(
                    members[:n], vertices[:m], least, mark[0], tried, labels, costs, corner_cost, graph
                )
                if label >= 0:
                    is_new = True
                    for i in range(n):
                        labels[members[i]] = label
                    for i in range(m):
                        note(vertices[i], mark[0], changed, graph)
            if not is_new:
                break


@kernel
def _gather(c, label, mark, members, cell_mark, labels, costs, graph):  # type: ignore[no-untyped-def]
    """Write the cells about one of its plane, or that another fits as well; return their number and gain."""
    _, _, begin, around, _, sides, _, _, _, _, _ = graph
    members[0], cell_mark[c], n, done, gain = c, mark, 1, 0, 0.0
    while done < n:
        one = members[done]
        gain += costs[one, labels[one]] - costs[one, label]
        for k in range(begin[one], begin[one + 1]):
            for side in range(2):
                o = sides[around[k], side]
                if o < 0 or cell_mark[o] == mark:
                    continue
                own = labels[o]
                if (
                    own == labels[c]
                    if label == labels[c]
                    else (own != label and costs[o, label] <= costs[o, own])
                ):
                    cell_mark[o], members[n] = mark, o
                    n += 1
        done += 1
    return n, gain


@kernel
def _touch(members, mark, vertices, vertex_mark, labels, graph):  # type: ignore[no-untyped-def]
    """Write the vertices at which a face ends; return how many."""
    _, _, begin, around, borders, sides, _, _, _, _, _ = graph
    n = 0
    for c in members:
        for k in range(begin[c], begin[c + 1]):
            e = around[k]
            is_border = plane_of(sides[e, 0], labels) != plane_of(sides[e, 1], labels)
            for end in range(2 if is_border else 0):
                v = borders[e, end]
                if vertex_mark[v] != mark:
                    vertex_mark[v], vertices[n] = mark, v
                    n += 1
    return n


@kernel
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
