"""How long the description of a partition is: misfit, borders, and corners as people draw them."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.few_rows import rows_by_group

#: Edges that turn by less run straight on: sine of the angle.
_STRAIGHT = 0.02
#: Corners of faces at one place are one corner if their elevations differ by less [m].
_ONE_CORNER = 0.02


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


@kernel
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
        start, before, n = -1, -1, 0
        for k in range(first[v], first[v + 1]):
            e = rows[k]
            if plane_beside(e, 0, sides, labels) == plane_beside(e, 1, sides, labels):
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


@kernel
def whole_length(labels, costs, corner_cost, graph):  # type: ignore[no-untyped-def]
    """Return what all cells, edges and vertices cost [m³]."""
    first, _, _, _, _, sides, _, prices, _, _, _ = graph
    vertices = np.arange(len(first) - 1)
    total = length_of(vertices[:0], vertices, np.inf, labels, costs, corner_cost, graph)
    for c in range(len(labels)):
        total += costs[c, labels[c]]
    for e in range(len(sides)):
        one, other = sides[e, 0], sides[e, 1]
        if one >= 0 and other >= 0 and labels[one] != labels[other]:
            total += prices[e]
    return total


@kernel
def plane_beside(e, side, sides, labels):  # type: ignore[no-untyped-def]
    """Plane on one side of an edge, -1 beside the outline."""
    return labels[sides[e, side]] if sides[e, side] >= 0 else -1


@kernel
def _corners(v, one, other, n, labels, graph):  # type: ignore[no-untyped-def]
    """Return the number of corners at a vertex, with that of the face between two edges if it turns there."""
    _, _, _, _, borders, sides, courses, _, spots, planes, heights = graph
    # To the left of an edge that leaves the vertex lies what follows by rising direction.
    inside = sides[one, 0] if borders[one, 0] == v else sides[one, 1]
    is_straight = abs(courses[one, 0] * courses[other, 1] - courses[one, 1] * courses[other, 0]) < _STRAIGHT
    if inside < 0 or is_straight:
        return n
    p = labels[inside]
    heights[n] = planes[p, 0] * spots[v, 0] + planes[p, 1] * spots[v, 1] + planes[p, 2]
    for k in range(n):
        if abs(heights[k] - heights[n]) < _ONE_CORNER:
            return n
    return n + 1
