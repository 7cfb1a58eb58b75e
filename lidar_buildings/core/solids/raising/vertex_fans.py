"""The half-edges around each vertex of a plan, and the elevations at which pieces meet above it."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.few_rows import rows_by_group
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.solids.raising.edge_columns import CCW, CW, EDGE, JOINED, LEFT, LEVEL, START, X, Y
from lidar_buildings.core.solids.raising.minimum_height import MIN_HEIGHT
from lidar_buildings.core.solids.raising.plan_graph import OUTSIDE

#: Least height above the ground [steps of the grid].
_MIN_STEPS = round(MIN_HEIGHT / GRID)


@kernel
def link(vertices: IntArray, edges: IntArray, planes: FloatArray, ground: int, within: float) -> None:
    """Find the half-edges around every vertex and the elevations there."""
    order, first = rows_by_group(edges[:, START], len(vertices))
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


@kernel
def raw_elevation(planes: FloatArray, x: int, y: int, piece: int) -> float:
    """Return the elevation of a piece's own plane at a place [steps of the grid]."""
    return (planes[piece, 0] * (x * GRID) + planes[piece, 1] * (y * GRID) + planes[piece, 2]) / GRID


@kernel
def measure(
    vertices: IntArray,
    edges: IntArray,
    planes: FloatArray,
    v: int,
    fan: IntArray,
    value: FloatArray,
    ground: int,
    within: float,
) -> None:
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
