"""
The edges of a plan in both directions, and the elevations at which pieces meet above its vertices.

Where the profiles of two pieces cross along their common edge it is divided; where four walls would meet, one
valley is drawn back.
"""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.few_rows import rows_by_group
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.solids.plan_graph import MIN_HEIGHT
from lidar_buildings.core.solids.planar_subdivision import OUTSIDE, PlanGraph

#: Columns of vertices: place in steps of the grid, a half-edge that starts there (the first counter-clockwise
#: from −x on, −1 for none), whether all pieces have to meet there in one elevation.
X, Y, EDGE, JOINED = range(4)
#: Columns of half-edges, of which 2k and 2k + 1 are one edge: the vertex where one starts, the piece to its
#: left, the next ones around its start, counter-clockwise and clockwise, and its piece's elevation there.
START, LEFT, CCW, CW, LEVEL = range(5)


#: Least height above the ground [steps of the grid].
_MIN_STEPS = round(MIN_HEIGHT / GRID)


@kernel
def link(vertices: IntArray, edges: IntArray, planes: FloatArray, ground: int, within: float) -> None:
    """Find the half-edges around every vertex and the elevations there."""
    order, first = rows_by_group(edges[:, START].copy(), len(vertices))
    fan, value = np.empty(len(order), dtype=np.int64), np.empty(len(order))
    for v in range(len(vertices)):
        n = first[v + 1] - first[v]
        for k in range(n):
            fan[k] = order[first[v] + k]
        arrange(vertices, edges, v, fan, n, value)
        measure(vertices, edges, planes, v, fan, value, ground, within)


@kernel
def arrange(vertices: IntArray, edges: IntArray, v: int, fan: IntArray, n: int, value: FloatArray) -> None:
    """Link the n half-edges of a vertex counter-clockwise, from the direction of −x on."""
    for i in range(n):
        e = fan[i]
        end = edges[e ^ 1, START]
        angle = math.atan2(vertices[end, Y] - vertices[v, Y], vertices[end, X] - vertices[v, X])
        k = i
        while k > 0 and value[k - 1] > angle:
            value[k], fan[k] = value[k - 1], fan[k - 1]
            k -= 1
        value[k], fan[k] = angle, e
    for i in range(n):
        after = fan[i + 1 if i + 1 < n else 0]
        edges[fan[i], CCW] = after
        edges[after, CW] = fan[i]
    vertices[v, EDGE] = fan[0] if n else -1


@kernel
def fan_of(vertices: IntArray, edges: IntArray, v: int, fan: IntArray) -> int:
    """Put the half-edges around a vertex into `fan` and return how many there are."""
    n, e = 0, vertices[v, EDGE]
    while e >= 0:
        fan[n] = e
        n += 1
        e = edges[e, CCW]
        if e == vertices[v, EDGE]:
            break
    return n


@inner_kernel
def raw_elevation(planes: FloatArray, x: int, y: int, piece: int) -> float:
    """Return the elevation of a piece's own plane at a place [steps of the grid]."""
    return (planes[piece, 0] * (x * GRID) + planes[piece, 1] * (y * GRID) + planes[piece, 2]) / GRID


@kernel
def measure(vertices, edges, planes, v, fan, value, ground, within):  # type: ignore[no-untyped-def]
    """Measure the elevations at a vertex and make almost equal ones one, from the lowest on."""
    n = 0
    e = vertices[v, EDGE]
    while e >= 0:
        if edges[e, LEFT] == OUTSIDE:
            edges[e, LEVEL] = ground
        else:
            raw = raw_elevation(planes, vertices[v, X], vertices[v, Y], edges[e, LEFT])
            k = n
            while k > 0 and value[k - 1] > raw:
                value[k], fan[k] = value[k - 1], fan[k - 1]
                k -= 1
            value[k], fan[k] = raw, e
            n += 1
        e = edges[e, CCW]
        if e == vertices[v, EDGE]:
            break
    first = 0
    for last in range(1, n + 1):
        if last == n or (value[last] - value[first] > within and not vertices[v, JOINED]):
            level = int(np.rint(0.5 * (value[first] + value[last - 1])))
            for k in range(first, last):
                edges[fan[k], LEVEL] = max(level, ground + _MIN_STEPS)
            first = last


@kernel
def level_of(edges: IntArray, e: int, piece: int) -> int:
    """Return the elevation of a piece at the start of a half-edge beside it."""
    other = edges[e, CW]
    while edges[other, LEFT] != piece and other != e:
        other = edges[other, CW]
    return edges[other, LEVEL]


#: How far a valley's tip is drawn back, in steps of the grid.
DRAWN_BACK = 10


@kernel
def valley_to_cut(edges: IntArray, fan: IntArray, n: int) -> tuple[int, int]:
    """Return the first and the last sector of the shallowest valley to cut, −1 if the vertex is sound."""
    chosen, chosen_last, shallowest = -1, -1, 0
    if n < 4:
        return chosen, chosen_last
    top = edges[fan[0], LEVEL]
    for k in range(n):
        top = max(top, edges[fan[k], LEVEL])
    while True:
        # the next lower elevation
        level, found = top, False
        for k in range(n):
            height = edges[fan[k], LEVEL]
            if height < top and (not found or height > level):
                level, found = height, True
        if not found:
            return -1, -1
        top = level
        n_valleys = 0
        for start in range(n):
            if not edges[fan[start], LEVEL] <= level < edges[fan[start - 1 if start else n - 1], LEVEL]:
                continue
            last, lowest = start, edges[fan[start], LEVEL]
            while edges[fan[(last + 1) % n], LEVEL] <= level:
                last = (last + 1) % n
                lowest = min(lowest, edges[fan[last], LEVEL])
            if n_valleys == 0 or lowest > shallowest:
                chosen, chosen_last, shallowest = start, last, lowest
            n_valleys += 1
        if n_valleys > 1:
            return chosen, chosen_last


@kernel
def find_apex(vertices: IntArray, edges: IntArray, v: int, first: int, last: int, new: int) -> None:
    """Put a vertex on the bisector between two half-edges, the first one clockwise of the second."""
    p, q = edges[first ^ 1, START], edges[last ^ 1, START]
    px, py = vertices[p, X] - vertices[v, X], vertices[p, Y] - vertices[v, Y]
    qx, qy = vertices[q, X] - vertices[v, X], vertices[q, Y] - vertices[v, Y]
    begin = math.atan2(py, px)
    opening = (math.atan2(qy, qx) - begin) % (2.0 * math.pi)
    half = 0.5 * (opening if opening != 0.0 else 2.0 * math.pi)
    vertices[new, X] = int(np.rint(vertices[v, X] + DRAWN_BACK * math.cos(begin + half)))
    vertices[new, Y] = int(np.rint(vertices[v, Y] + DRAWN_BACK * math.sin(begin + half)))


#: Elevations at one vertex within this become one: no face leaves its plane by more than half of it [m].
_MERGE_TOLERANCE = 0.008
#: Repairs may make others necessary; no more rounds than this.
_MAX_ROUNDS = 10


class HalfEdges:
    """
    A plan's half-edges, repaired so that a shell can be raised on them.

    `vertices` has columns X, Y, EDGE, JOINED, `edges` (two rows for each edge) START, LEFT, CCW, CW, LEVEL;
    `order` are the half-edges by the places of their starts, then of their ends.
    """

    def __init__(self, graph: PlanGraph, planes: FloatArray, ground: int) -> None:
        self._vertices = np.zeros((len(graph.places), 4), dtype=np.int64)
        self._vertices[:, :2] = graph.places
        self._edges = np.zeros((2 * len(graph.ends), 5), dtype=np.int64)
        self._edges[:, START] = graph.ends.ravel()
        self._edges[:, LEFT] = graph.sides.ravel()
        self._sizes = np.array([len(self._vertices), len(self._edges)])
        within = _MERGE_TOLERANCE / GRID
        link(self._vertices, self._edges, planes, ground, within)
        for _ in range(_MAX_ROUNDS):
            by_place, self.order = self._orders()
            # Room for all that one round may add.
            n_vertices, n_edges = self._sizes.tolist()
            most = n_edges // 2 + n_vertices
            self._vertices = np.concatenate([self.vertices, np.zeros((most, 4), dtype=np.int64)])
            self._edges = np.concatenate([self.edges, np.zeros((2 * most, 5), dtype=np.int64)])
            changed = _repair(
                self._vertices, self._edges, self._sizes, planes, by_place, self.order, ground, within
            )
            if not changed:
                break
        else:
            self.order = self._orders()[1]

    @property
    def vertices(self) -> IntArray:
        """The vertices that there are."""
        return self._vertices[: self._sizes[0]]

    @property
    def edges(self) -> IntArray:
        """The half-edges that there are."""
        return self._edges[: self._sizes[1]]

    def _orders(self) -> tuple[IntArray, IntArray]:
        """Return the vertices by place, and the half-edges by the places of their starts, then ends."""
        by_place = np.lexsort((self.vertices[:, Y], self.vertices[:, X]))
        rank = np.empty_like(by_place)
        rank[by_place] = np.arange(len(rank))
        starts = rank[self.edges[:, START]]
        ends = starts.reshape(-1, 2)[:, ::-1].ravel()
        return by_place, np.argsort(starts * len(rank) + ends)


@kernel
def _repair(vertices, edges, sizes, planes, vertex_order, edge_order, ground, within):  # type: ignore[no-untyped-def]
    """Divide all edges where profiles cross, then draw valleys back; return whether there were any."""
    changed = False
    most = len(edges)
    fan, moved, value = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64), np.empty(most)
    for e in edge_order:
        a, b = edges[e, START], edges[e ^ 1, START]
        left, right = edges[e, LEFT], edges[e ^ 1, LEFT]
        if left == OUTSIDE or right == OUTSIDE:
            continue
        if not (
            vertices[a, X] < vertices[b, X]
            or (vertices[a, X] == vertices[b, X] and vertices[a, Y] < vertices[b, Y])
        ):
            continue
        at_start = edges[e, LEVEL] - level_of(edges, e, right)
        at_end = level_of(edges, e ^ 1, left) - edges[e ^ 1, LEVEL]
        if at_start == 0 or at_end == 0 or (at_start > 0) == (at_end > 0):
            continue
        new = sizes[0]
        _find_crossing(vertices, planes, a, b, left, right, new)
        if _is_taken(vertices, new):
            continue
        sizes[0] += 1
        vertices[new, JOINED] = 1
        _split_edge(vertices, edges, sizes, e, new, fan, value)
        measure(vertices, edges, planes, new, fan, value, ground, within)
        changed = True
    for v in vertex_order:
        n = fan_of(vertices, edges, v, fan)
        first, last = valley_to_cut(edges, fan, n)
        if first < 0:
            continue
        new = sizes[0]
        find_apex(vertices, edges, v, fan[first], fan[(last + 1) % n], new)
        if _is_taken(vertices, new):
            continue
        sizes[0] += 1
        vertices[new, JOINED] = 0
        _cut_corner(vertices, edges, sizes, v, first, last, new, fan, n, moved, value)
        measure(vertices, edges, planes, v, fan, value, ground, within)
        measure(vertices, edges, planes, new, fan, value, ground, within)
        changed = True
    return changed


@kernel
def _is_taken(vertices: IntArray, new: int) -> bool:
    for v in range(new):
        if (
            vertices[v, X] == vertices[new, X]
            and vertices[v, Y] == vertices[new, Y]
            and vertices[v, EDGE] >= 0
        ):
            return True
    return False


@kernel
def _find_crossing(vertices, planes, a, b, left, right, new):  # type: ignore[no-untyped-def]
    """Put a vertex on the place of the grid that is nearest to the crossing of both pieces."""
    ax, ay, bx, by = vertices[a, X], vertices[a, Y], vertices[b, X], vertices[b, Y]
    first = raw_elevation(planes, ax, ay, left) - raw_elevation(planes, ax, ay, right)
    last = raw_elevation(planes, bx, by, left) - raw_elevation(planes, bx, by, right)
    share = first / (first - last) if first != last else 0.5
    vertices[new, X] = int(np.rint(ax + share * (bx - ax)))
    vertices[new, Y] = int(np.rint(ay + share * (by - ay)))


@kernel
def _split_edge(vertices, edges, sizes, e, new, fan, value):  # type: ignore[no-untyped-def]
    a, b = edges[e, START], edges[e ^ 1, START]
    half = sizes[1]
    sizes[1] += 2
    edges[half, START], edges[half + 1, START] = new, b
    for column in (LEFT, LEVEL):
        edges[half, column], edges[half + 1, column] = edges[e, column], edges[e ^ 1, column]
    n = fan_of(vertices, edges, b, fan)
    for k in range(n):
        if fan[k] == e ^ 1:
            fan[k] = half + 1
    edges[e ^ 1, START] = new
    arrange(vertices, edges, b, fan, n, value)
    arrange(vertices, edges, a, fan, fan_of(vertices, edges, a, fan), value)
    fan[0], fan[1] = e ^ 1, half
    arrange(vertices, edges, new, fan, np.int64(2), value)


@kernel
def _cut_corner(vertices, edges, sizes, v, first, last, new, fan, n, moved, value):  # type: ignore[no-untyped-def]
    """Draw the sectors first to last back from a vertex to a new one, so that those beside them meet."""
    n_moved = (last - first) % n + 2
    for k in range(n_moved):
        moved[k] = fan[(first + k) % n]
    n_kept = n - n_moved
    kept = np.empty(n_kept + 1, dtype=np.int64)
    for k in range(n_kept):
        kept[k] = fan[(first + n_moved + k) % n]
    before, after = edges[moved[0] ^ 1, LEFT], edges[moved[n_moved - 1], LEFT]
    for k in range(n_moved):
        edges[moved[k], START] = new
    for k in range(n_moved):
        end = edges[moved[k] ^ 1, START]
        size = fan_of(vertices, edges, end, fan)
        arrange(vertices, edges, end, fan, size, value)
    if before != after:
        half = sizes[1]
        sizes[1] += 2
        edges[half, START], edges[half, LEFT] = v, after
        edges[half + 1, START], edges[half + 1, LEFT] = new, before
        kept[n_kept] = half
        n_kept += 1
        moved[n_moved] = half + 1
        n_moved += 1
    arrange(vertices, edges, v, kept, n_kept, value)
    arrange(vertices, edges, new, moved, n_moved, value)
