"""Fewer corners once more: vertices of faces move into neighbours where points do not miss them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import islice

import numpy as np

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.stages.building_model.cell_costs import counted_shares, misfit_of
from lidar_buildings.core.stages.building_model.simplification import EPSILON, ONE_CORNER, STRAIGHT
from lidar_buildings.core.stages.building_model.spikes import ONE_HEIGHT, Limits, is_left, level_limits

#: Edges that move keep so far from vertices, and those of the outline so near to where they were [m].
_CLEAR, _ON_WALL = 0.02, 0.003


def contracted(
    rings: Sequence[tuple[FloatArray, ...]],
    planes: FloatArray,
    over: IntArray,
    kept: FloatArray,
    limits: Limits,
    points: FloatArray,
    weights: FloatArray,
    prices: tuple[float, float],
) -> list[tuple[FloatArray, ...]]:
    """
    Move vertices of faces into neighbours, one by one, where the description of the roof gets shorter.

    Its length is that of `simplified`. All faces and the outline stay, and corners keep to the limits.

    - `rings`: Of each face, which share their vertices [m].
    - `planes`, shape (n_faces, 3): z = a·x + b·y + c.
    - `over`, shape (n_points,), int64: The face below each of the points, -1 for none; is changed.
    - `kept`, shape (n, 2): Vertices that stay [m].
    - `points`, shape (n_points, 3): By rising y [m].
    - `weights`, shape (n_points,): The area that points stand for [m²].
    - `prices`: Of a metre of border [m²], and of a corner [m³].
    """
    sizes = np.array([len(ring) for own in rings for ring in own], dtype=np.int64)
    if len(rings) < 2 or not len(sizes):
        return list(rings)
    corners = np.concatenate([ring for own in rings for ring in own])
    places, vertex = np.unique(corners, axis=0, return_inverse=True)
    keys, of_kept = (xy @ (1.0, 1j) for xy in (places, kept))
    ends = np.cumsum(sizes)
    after, before = np.arange(1, len(corners) + 1), np.arange(-1, len(corners) - 1)
    after[ends - 1], before[ends - sizes] = ends - sizes, ends - 1
    face = np.repeat([f for f, own in enumerate(rings) for _ in own], sizes)
    nodes = np.column_stack([vertex.reshape(-1), after, before, face])
    low, high = level_limits(places, limits.near, limits.spacing)
    _contract(
        nodes, places, np.isin(keys, of_kept), low, high, planes, counted_shares(planes),
        over, points, weights, limits, prices,
    )  # fmt: skip
    parts = iter(np.split(nodes[:, _VERTEX], ends[:-1]))
    return [tuple(places[part[part >= 0]] for part in islice(parts, len(own))) for own in rings]


#: Columns of nodes, which rings consist of: vertex, -1 if it is gone, next node, the one before, face.
_VERTEX, _NEXT, _BEFORE, _FACE = range(4)


@kernel
def _contract(  # type: ignore[no-untyped-def]
    nodes, places, is_kept, low, high, planes, counted, over, points, weights, limits, prices
):
    known = places, low, high, planes, counted, points, weights, limits, prices
    lengths, edges = np.empty(2 * len(nodes)), np.empty((2 * len(nodes), 2), np.int64)
    rows, faces = np.empty(len(points), np.int64), np.empty(len(points), np.int64)
    # The round in which what lies round a vertex last changed.
    changed, this_round = np.zeros(len(places), np.int64), 0
    while changed.max() == this_round:
        n, this_round = 0, this_round + 1
        for u, after, before, _ in nodes:
            for way in (after, before):
                v = nodes[way, _VERTEX]
                if u < 0 or is_kept[u] or max(changed[u], changed[v]) < this_round - 1:
                    continue
                if way == after or _is_outer(v, u, nodes):
                    edges[n, 0], edges[n, 1], lengths[n] = u, v, _distance(u, v, places)
                    n += 1
        for k in np.argsort(lengths[:n], kind="mergesort"):
            u, v = edges[k]
            around, at = _around(u, nodes)
            if v not in around:
                continue
            given = nodes.copy()
            gain, n_changed = _moved(u, v, around, at, nodes, over, rows, faces, known)
            if gain > EPSILON and _is_free(u, v, around, given, places) and _is_explained(v, nodes, known):
                changed[around] = this_round
                for i in range(n_changed):
                    over[rows[i]] = faces[i]
            else:
                nodes[:] = given


@kernel
def _is_outer(u, v, nodes):  # type: ignore[no-untyped-def]
    """Tell whether no face has the edge from the second to the first vertex."""
    n = 0
    for one, after, _, _ in nodes:
        n += one == v and nodes[after, _VERTEX] == u
    return n == 0


@kernel
def _moved(u, v, around, at, nodes, over, rows, faces, known):  # type: ignore[no-untyped-def]
    """
    Move vertex u into v; return what is gained [m³], and how many points change their faces.

    0 if a face would vanish or touch itself; the points and their faces are written.
    """
    places, _, _, planes, counted, points, weights, _, prices = known
    gain = prices[1] * _corners(u, nodes, places, planes)
    for w in around:
        gain += prices[1] * _corners(w, nodes, places, planes) + prices[0] * _distance(u, w, places)
        if w != v:
            gain -= prices[0] * _distance(v, w, places)
    is_its, is_in = np.zeros(len(planes), np.bool_), np.zeros(len(planes), np.bool_)
    for i in at:
        is_its[nodes[i, _FACE]] = True
        one, other = nodes[i, _BEFORE], nodes[i, _NEXT]
        nodes[i, _VERTEX] = v
        if nodes[one, _VERTEX] == v or nodes[other, _VERTEX] == v:
            nodes[one, _NEXT], nodes[other, _BEFORE], nodes[i, _VERTEX] = other, one, -1
            if nodes[other, _NEXT] == one:
                return 0.0, 0
    there = nodes[nodes[:, _VERTEX] == v, _FACE]
    if len(np.unique(there)) < len(there):
        return 0.0, 0
    for w in around:
        gain -= prices[1] * _corners(w, nodes, places, planes)
    if gain <= EPSILON:
        return 0.0, 0
    own = nodes[is_its[nodes[:, _FACE]] & (nodes[:, _VERTEX] >= 0)]
    x, y = places[np.append(around, u), 0], places[np.append(around, u), 1]
    west, south, east, north, n = x.min(), y.min(), x.max(), y.max(), 0
    for i in range(np.searchsorted(points[:, 1], south), np.searchsorted(points[:, 1], north)):
        (x, y, z), old, is_swept = points[i], over[i], False
        if not west <= x <= east or old < 0 or not is_its[old]:
            continue
        for w in around:
            is_swept |= _is_between(x, y, u, v, w, places)
        new = _face_over(x, y, own, is_in, nodes, places) if is_swept else -1
        if new < 0 or new == old:
            continue
        rows[n], faces[n], n = i, new, n + 1
        for f, sign in ((old, 1.0), (new, -1.0)):
            off = abs(z - (planes[f, 0] * x + planes[f, 1] * y + planes[f, 2]))
            gain += sign * weights[i] * misfit_of(counted[f] * off)
    return gain, n


@inner_kernel
def _distance(u, w, places):  # type: ignore[no-untyped-def]
    return math.hypot(places[u, 0] - places[w, 0], places[u, 1] - places[w, 1])


@kernel
def _around(u, nodes):  # type: ignore[no-untyped-def]
    """Return the vertices next to one, each once, and its nodes."""
    at = np.flatnonzero(nodes[:, _VERTEX] == u)
    around = np.empty(2 * len(at), np.int64)
    for k in range(len(at)):
        around[2 * k] = nodes[nodes[at[k], _BEFORE], _VERTEX]
        around[2 * k + 1] = nodes[nodes[at[k], _NEXT], _VERTEX]
    return np.unique(around), at


@kernel
def _is_free(u, v, around, nodes, places):  # type: ignore[no-untyped-def]
    """Tell whether nothing lies where edges move with vertex u into v, and the outline stays."""
    n_outer, is_along = 0, False
    for w in around:
        if _is_outer(u, w, nodes) or _is_outer(w, u, nodes):
            n_outer, is_along = n_outer + 1, is_along or w == v
            if w != v and _off_edge(u, w, v, places) > _ON_WALL:
                return False
    # What lies on a wall, between two edges of the outline, moves along one of them.
    if n_outer > 0 and not (n_outer == 2 and is_along):
        return False
    x, y = places[np.append(around, u), 0], places[np.append(around, u), 1]
    west, south, east, north = x.min() - _CLEAR, y.min() - _CLEAR, x.max() + _CLEAR, y.max() + _CLEAR
    for one in nodes[:, _VERTEX]:
        if one < 0 or one in (u, v):
            continue
        x, y = places[one]
        if not (west <= x <= east and south <= y <= north):
            continue
        for w in around:
            if w not in (v, one) and (
                _off_edge(one, w, v, places) < _CLEAR or _is_between(x, y, u, v, w, places)
            ):
                return False
    return True


@kernel
def _off_edge(w, a, b, places):  # type: ignore[no-untyped-def]
    """Return how far a vertex lies from the edge between two others [m]."""
    ux, uy = places[b, 0] - places[a, 0], places[b, 1] - places[a, 1]
    px, py = places[w, 0] - places[a, 0], places[w, 1] - places[a, 1]
    square = ux * ux + uy * uy
    share = min(max((px * ux + py * uy) / square, 0.0), 1.0) if square > 0.0 else 0.0
    return math.hypot(px - share * ux, py - share * uy)


@kernel
def _corners(v, nodes, places, planes):  # type: ignore[no-untyped-def]
    """Return the number of corners at a vertex, as `simplification` counts them."""
    heights, n = np.empty(len(nodes)), 0
    for i in np.flatnonzero(nodes[:, _VERTEX] == v):
        one, other = nodes[nodes[i, _BEFORE], _VERTEX], nodes[nodes[i, _NEXT], _VERTEX]
        ax, ay = places[v, 0] - places[one, 0], places[v, 1] - places[one, 1]
        bx, by = places[other, 0] - places[v, 0], places[other, 1] - places[v, 1]
        if abs(ax * by - ay * bx) < STRAIGHT * math.hypot(ax, ay) * math.hypot(bx, by):
            continue
        a, b, c = planes[nodes[i, _FACE]]
        heights[n] = a * places[v, 0] + b * places[v, 1] + c
        is_new = True
        for k in range(n):
            is_new &= abs(heights[k] - heights[n]) >= ONE_CORNER
        n += is_new
    return n


@kernel
def _is_explained(v, nodes, known):  # type: ignore[no-untyped-def]
    """Tell whether points explain the corners at a vertex, and where planes cross on edges from it."""
    places, low, high, planes, _, _, _, (near, spacing, floor), _ = known
    x, y = places[v]
    for i in np.flatnonzero(nodes[:, _VERTEX] == v):
        a, b, c = planes[nodes[i, _FACE]]
        z, slope = a * x + b * y + c, math.hypot(a, b)
        for k in range(len(nodes)):
            if nodes[k, _VERTEX] == v:
                d, e, f = planes[nodes[k, _FACE]]
                if abs(d * x + e * y + f - z) <= ONE_HEIGHT:
                    slope = min(slope, math.hypot(d, e))
                # The face beyond the next edge.
                w = nodes[nodes[i, _NEXT], _VERTEX]
                if nodes[nodes[k, _BEFORE], _VERTEX] == w:
                    one = z - (d * x + e * y + f)
                    other = (a - d) * places[w, 0] + (b - e) * places[w, 1] + c - f
                    if one * other < 0.0:
                        share = one / (one - other)
                        place = np.empty((1, 2))
                        place[0, 0] = x + share * (places[w, 0] - x)
                        place[0, 1] = y + share * (places[w, 1] - y)
                        lowest, highest = level_limits(place, near, spacing)
                        between = a * place[0, 0] + b * place[0, 1] + c
                        least = min(math.hypot(a, b), math.hypot(d, e))
                        if is_left(between, least, lowest[0], highest[0], spacing, floor):
                            return False
        if is_left(z, slope, low[v], high[v], spacing, floor):
            return False
    return True


@inner_kernel
def _is_between(x, y, u, v, w, places):  # type: ignore[no-untyped-def]
    """Tell whether a place lies in a triangle."""
    (ax, ay), (bx, by), (cx, cy) = places[u], places[v], places[w]
    one = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
    two = (cx - bx) * (y - by) - (cy - by) * (x - bx)
    three = (ax - cx) * (y - cy) - (ay - cy) * (x - cx)
    return min(one, two, three) >= 0.0 or max(one, two, three) <= 0.0


@kernel
def _face_over(x, y, own, is_in, nodes, places):  # type: ignore[no-untyped-def]
    """Return in which of the faces whose nodes are `own` a place lies, -1 for none."""
    is_in[:] = False
    for u, after, _, face in own:
        ax, ay = places[u]
        bx, by = places[nodes[after, _VERTEX]]
        if (ay > y) != (by > y) and x < ax + (bx - ax) * (y - ay) / (by - ay):
            is_in[face] = not is_in[face]
    for face in range(len(is_in)):
        if is_in[face]:
            return face
    return -1
