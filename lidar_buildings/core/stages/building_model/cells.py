"""
The cells into which lines cut an outline, and the rings round sets of them.

Edge e from its lower to its higher vertex is half-edge 2e, the way back 2e + 1. The rotation of a vertex is
its half-edges by direction, counter-clockwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.neighbours.few_rows import rows_by_group, sort_rows
from lidar_buildings.core.neighbours.union_find import link, root
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.stages.building_model.noding import node_segments


class Rotation(NamedTuple):
    """The half-edges round every vertex."""

    first: IntArray  #: where each vertex's half-edges begin in `order`, shape (n_vertices + 1,)
    order: IntArray  #: numbers of half-edges, shape (n_half_edges,)
    place: IntArray  #: where each half-edge stands in `order`, shape (n_half_edges,)


@kernel
def enclosed_cells(vertices, edges, enclosed):  # type: ignore[no-untyped-def]
    """
    Find the faces of a graph that lie inside its outline.

    Parameters
    ----------
    vertices, edges, enclosed : ndarray
        As returned by `node_segments`.

    Returns
    -------
    first, order, place : ndarray
        The rotation.
    sides : ndarray of shape (n_edges, 2), int64
        Face to the left of each edge and to the right, -1 = outside; edges that bound no face have -1 on both
        sides. Faces rise by the lower corner of the box round them, then by the upper one.
    doubled : ndarray of shape (n_faces,)
        Twice the area of each face.
    """
    first, order, place = _rotation(vertices, edges)
    face = np.empty(2 * len(edges), np.int64)
    n = _enclosed(vertices, edges, enclosed, first, order, place, face)
    largest = np.iinfo(np.int64).max
    low, high = np.full((n, 2), largest), np.full((n, 2), -largest)
    for half in range(len(face)):
        if face[half] >= 0:
            f, v = face[half], edges[half >> 1, half & 1]
            for axis in range(2):
                low[f, axis] = min(low[f, axis], vertices[v, axis])
                high[f, axis] = max(high[f, axis], vertices[v, axis])
    keys, rows, number = np.empty(n, np.int64), np.arange(n), np.empty(n, np.int64)
    for f in range(n):
        # Vertices rise by x: the first one is the westernmost.
        keys[f] = ((low[f, 0] - vertices[0, 0]) << 32) + low[f, 1] + (1 << 31) - vertices[0, 1]
    sort_rows(keys, rows, n)
    for k in range(n):
        m, f = k, rows[k]
        while (
            m > 0
            and keys[m - 1] == keys[k]
            and (high[f, 0], high[f, 1]) < (high[rows[m - 1], 0], high[rows[m - 1], 1])
        ):
            rows[m] = rows[m - 1]
            m -= 1
        rows[m] = f
    for k in range(n):
        number[rows[k]] = k
    sides, doubled = np.empty_like(edges), np.zeros(n)
    for half in range(len(face)):
        f = face[half]
        sides[half >> 1, half & 1] = -1 if f < 0 else number[f]
        if f >= 0:
            a, b = edges[half >> 1, half & 1], edges[half >> 1, 1 - (half & 1)]
            ax, ay = vertices[a, 0] - low[f, 0], vertices[a, 1] - low[f, 1]
            bx, by = vertices[b, 0] - low[f, 0], vertices[b, 1] - low[f, 1]
            doubled[number[f]] += ax * by - ay * bx
    return first, order, place, sides, doubled


@kernel
def _rotation(vertices, edges):  # type: ignore[no-untyped-def]
    """Sort the half-edges of a graph round its vertices: see `Rotation`."""
    order, first = rows_by_group(edges.reshape(-1), len(vertices))
    place, angle = np.empty(len(order), np.int64), np.empty(len(order))
    for e in range(len(edges)):
        a, b = edges[e, 0], edges[e, 1]
        angle[2 * e] = math.atan2(
            float(vertices[b, 1] - vertices[a, 1]), float(vertices[b, 0] - vertices[a, 0])
        )
        # The way back lies opposite: one rounding for both.
        angle[2 * e + 1] = angle[2 * e] - math.pi if angle[2 * e] > 0.0 else angle[2 * e] + math.pi
    for v in range(len(vertices)):
        for m in range(first[v] + 1, first[v + 1]):
            half, k = order[m], m
            while k > first[v] and angle[order[k - 1]] > angle[half]:
                order[k] = order[k - 1]
                k -= 1
            order[k] = half
    for k in range(len(order)):
        place[order[k]] = k
    return first, order, place


@kernel
def next_half_edge(half, ends, first, order, place, face):  # type: ignore[no-untyped-def]
    """Return the half-edge that goes on round what lies to the left, by way of borders of faces only."""
    back = half ^ 1
    v, k = ends[back], place[back]
    while True:
        k = k - 1 if k > first[v] else first[v + 1] - 1
        onward = order[k]
        if face[onward] != face[onward ^ 1]:
            return onward


@kernel
def _enclosed(vertices, edges, enclosed, first, order, place, face):  # type: ignore[no-untyped-def]
    """Number faces in place; return how many."""
    ends = edges.reshape(-1)
    # Until there are faces, half-edges that differ from their twins are those of the graph.
    for half in range(len(ends)):
        face[half] = -2 - (half & 1)
    degree = first[1:] - first[:-1]
    for begin in range(len(degree)):
        v = begin
        while degree[v] == 1:
            for k in range(first[v], first[v + 1]):
                half = order[k]
                if face[half] != face[half ^ 1]:
                    face[half] = face[half ^ 1] = -1
                    degree[v] -= 1
                    v = ends[half ^ 1]
                    degree[v] -= 1
                    break
    walk = np.empty(len(ends), np.int64)
    area = np.empty(len(ends))
    n = 0
    for _ in range(2):
        walk[:] = -1
        n = 0
        for begin in range(len(ends)):
            if walk[begin] >= 0 or face[begin] == face[begin ^ 1]:
                continue
            half, area[n] = begin, 0.0
            x, y = vertices[ends[begin], 0], vertices[ends[begin], 1]
            while walk[half] < 0:
                walk[half] = n
                a, b = ends[half], ends[half ^ 1]
                area[n] += (vertices[a, 0] - x) * (vertices[b, 1] - y)
                area[n] -= (vertices[a, 1] - y) * (vertices[b, 0] - x)
                half = next_half_edge(half, ends, first, order, place, face)
            n += 1
        # Edges with one face on both sides bound nothing.
        bridges = 0
        for half in range(0, len(ends), 2):
            if walk[half] == walk[half + 1] and face[half] != face[half + 1]:
                face[half] = face[half + 1] = -1
                bridges += 1
        if bridges == 0:
            break
    # Walks the wrong way round are the outer sides of connected parts: they lie in the face below.
    parent = np.arange(n)
    outside = np.zeros(n, np.bool_)
    done = -1
    for half in range(len(ends)):
        w = walk[half]
        if w <= done or area[w] > 0.0:
            continue
        done = w
        below = _below(edges[half >> 1, 0], vertices, edges, walk)
        if below >= 0:
            link(parent, w, walk[2 * below])
        else:
            outside[w] = True
    inside = np.zeros(n)
    for e in range(len(edges)):
        one, other = walk[2 * e], walk[2 * e + 1]
        if one >= 0 and enclosed[e] == 0:
            link(parent, one, other)
    for e in range(len(edges)):
        one, other = walk[2 * e], walk[2 * e + 1]
        if one >= 0 and enclosed[e] != 0:
            a, b = edges[e, 0], edges[e, 1]
            length = np.hypot(vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1])
            inside[root(parent, one)] += enclosed[e] * length
            inside[root(parent, other)] -= enclosed[e] * length
    for w in range(n):
        if outside[w]:
            inside[root(parent, w)] = -1.0
    number = np.full(n, -1, np.int64)
    count = 0
    for w in range(n):
        if area[w] > 0.0 and inside[root(parent, w)] > 0.0:
            number[w] = count
            count += 1
    # The outer side of a part within a face belongs to the face.
    for half in range(len(ends)):
        w = walk[half]
        if w >= 0 and area[w] <= 0.0 and number[w] < 0 and not outside[w]:
            below = _below(edges[half >> 1, 0], vertices, edges, walk)
            number[w] = number[walk[2 * below]] if below >= 0 else -1
            outside[w] = True
    for half in range(len(ends)):
        face[half] = number[walk[half]] if walk[half] >= 0 else -1
    return count


@kernel
def _below(v, vertices, edges, walk):  # type: ignore[no-untyped-def]
    """Return the nearest edge of a face below a vertex, -1 if there is none."""
    x, y = vertices[v, 0], vertices[v, 1]
    best, nearest = -1, -np.inf
    for e in range(len(edges)):
        ax, bx = vertices[edges[e, 0], 0], vertices[edges[e, 1], 0]
        if walk[2 * e] < 0 or not ax <= x < bx:
            continue
        ay, by = vertices[edges[e, 0], 1], vertices[edges[e, 1], 1]
        at = ay + (by - ay) * (x - ax) / (bx - ax)
        if at < y and at > nearest:
            best, nearest = e, at
    return best


@dataclass(frozen=True, eq=False)
class Cells:
    """A coverage of an outline by cells that share whole edges."""

    vertices: FloatArray  #: by rising x, then y; multiples of the output grid [m], shape (n_vertices, 2)
    borders: IntArray  #: rows of the two vertices of every edge, the lower one first, shape (n_borders, 2)
    #: The cell to the left of each edge and that to the right, -1 = none, shape (n_borders, 2).
    sides: IntArray
    areas: FloatArray  #: [m²], shape (n_cells,)
    corners: IntArray  #: rows of the outline's own vertices
    _units: IntArray
    _rotation: Rotation

    def __len__(self) -> int:
        """Return the number of cells."""
        return len(self.areas)

    @property
    def polygons(self) -> NDArray[np.object_]:
        """The cells as polygons."""
        every = np.ones(len(self.vertices), dtype=np.bool_)
        rings = self.rings_of(np.arange(len(self)), every)
        return np.array([shapely.Polygon(group[0], group[1:]) for group in rings], dtype=object)

    def rings_of(self, face: IntArray, kept: BoolArray) -> list[tuple[FloatArray, ...]]:
        """
        Return the rings of faces, each of the cells with its number, that show the vertices that are kept.
        """
        number = np.append(face, -1)[self.sides].reshape(-1)
        rings = rings_round(self._units, self.borders, self._rotation, number, kept)
        return [tuple(self.vertices[rows] for rows in group) for group in rings]


def cut_into_cells(outline: Outline, segments: FloatArray) -> Cells:
    """
    Cut an outline, valid and on the output grid, along segments.

    The lines are noded with snap rounding on the output grid, so that the cells are valid as they will be
    written. Segments that end inside do not cut: see `extend_segments`.
    """
    units, borders, enclosed, corners = node_segments(ring_walls(outline.rings), segments)
    first, order, place, sides, doubled = enclosed_cells(units, borders, enclosed)
    scale = round(1.0 / GRID)
    areas, rotation = 0.5 * doubled / scale**2, Rotation(first, order, place)
    return Cells(units / scale, borders, sides, areas, corners, units, rotation)


def rings_round(
    vertices: IntArray, edges: IntArray, rotation: Rotation, face: IntArray, kept: BoolArray
) -> list[list[IntArray]]:
    """
    Return the rings round faces or sets of them: per face its outer ring, counter-clockwise, then its holes.

    `face` is the one to the left of each half-edge, -1 = none; rings show the vertices that are `kept`. They
    are simple, begin at their first vertex, and are rows of vertices; a face without a ring of three has
    none.
    """
    ends = edges.reshape(-1)
    corners = np.empty(len(ends), dtype=np.int64)
    ring = np.zeros((len(ends) + 1, 3), dtype=np.int64)
    n = _walk_round(vertices, ends, *rotation, face, kept, corners, ring)
    rings: list[list[IntArray]] = [[] for _ in range(int(face.max(initial=-1)) + 1)]
    outer = [-1] * len(rings)
    for k, (start, owner, area) in enumerate(ring[:n].tolist()):
        own = corners[start : ring[k + 1, 0]]
        if area > 0:
            outer[owner] = len(rings[owner])
        rings[owner].append(own)
    return [[group.pop(k), *group] if k >= 0 else [] for group, k in zip(rings, outer, strict=True)]


@kernel
def _walk_round(vertices, ends, first, order, place, face, kept, corners, ring):  # type: ignore[no-untyped-def]
    """Write all rings, and where each begins, its face and twice its area; return how many there are."""
    done = np.zeros(len(ends), np.bool_)
    at = np.full(len(first), -1, np.int64)
    stack = np.empty(len(ends) + 1, np.int64)
    n = 0
    for begin in range(len(ends)):
        if done[begin] or face[begin] < 0 or face[begin] == face[begin ^ 1]:
            continue
        half, depth = begin, 0
        while True:
            v = ends[half]
            if at[v] >= 0:
                # The walk has come back to a vertex: what lies between is a ring of its own.
                low, count = at[v], 0
                for k in range(low, depth):
                    at[stack[k]] = -1
                    if kept[stack[k]]:
                        stack[low + count] = stack[k]
                        count += 1
                depth = low
                if count >= 3:
                    lowest = low
                    for k in range(low, low + count):
                        lowest = k if stack[k] < stack[lowest] else lowest
                    start, area = ring[n, 0], 0
                    x, y = vertices[stack[lowest], 0], vertices[stack[lowest], 1]
                    for k in range(count):
                        a = stack[low + (lowest - low + k) % count]
                        b = stack[low + (lowest - low + k + 1) % count]
                        corners[start + k] = a
                        area += (vertices[a, 0] - x) * (vertices[b, 1] - y)
                        area -= (vertices[a, 1] - y) * (vertices[b, 0] - x)
                    ring[n, 1], ring[n, 2], ring[n + 1, 0] = face[begin], area, start + count
                    n += 1
            if done[half]:
                break
            done[half] = True
            at[v], stack[depth] = depth, v
            depth += 1
            half = next_half_edge(half, ends, first, order, place, face)
    return n
