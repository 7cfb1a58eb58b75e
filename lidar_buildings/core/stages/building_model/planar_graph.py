"""
Plane graphs as half-edges: what the edges enclose, and the rings round sets of faces.

Edge e from its lower to its higher vertex is half-edge 2e, the way back 2e + 1. The rotation of a vertex is
its half-edges by direction, counter-clockwise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import BoolArray, IntArray
from lidar_buildings.core.neighbours.union_find import link, root


class Rotation(NamedTuple):
    """
    The half-edges round every vertex.

    Attributes
    ----------
    first : ndarray of shape (n_vertices + 1,), int64
        Where each vertex's half-edges begin in `order`.
    order : ndarray of shape (n_half_edges,), int64
        Numbers of half-edges.
    place : ndarray of shape (n_half_edges,), int64
        Where each half-edge stands in `order`.
    """

    first: IntArray
    order: IntArray
    place: IntArray


def rotation_of(vertices: IntArray, edges: IntArray) -> Rotation:
    """Sort the half-edges of a graph round its vertices."""
    along = (vertices[edges[:, 1]] - vertices[edges[:, 0]]).astype(np.float64)
    angle = np.arctan2(along[:, 1], along[:, 0])
    # The way back lies opposite: one rounding for both.
    back = np.where(angle > 0.0, angle - np.pi, angle + np.pi)
    order = np.lexsort((np.column_stack([angle, back]).reshape(-1), edges.reshape(-1)))
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    first = np.zeros(len(vertices) + 1, dtype=np.int64)
    np.cumsum(np.bincount(edges.reshape(-1), minlength=len(vertices)), out=first[1:])
    return Rotation(first, order, place)


def enclosed_faces(
    vertices: IntArray, edges: IntArray, enclosed: IntArray, rotation: Rotation
) -> tuple[IntArray, int]:
    """
    Number the faces of a graph that lie inside its outline.

    Parameters
    ----------
    vertices, edges, enclosed : ndarray
        As returned by `node_segments`.
    rotation : Rotation

    Returns
    -------
    face : ndarray of shape (n_half_edges,), int64
        Face to the left of each half-edge, -1 = outside; edges that bound no face have -1 on both sides.
    n_faces : int
    """
    face = np.full(2 * len(edges), -1, dtype=np.int64)
    n_faces = _enclosed(vertices, edges, enclosed, *rotation, face)
    return face, n_faces


def rings_round(
    vertices: IntArray, edges: IntArray, rotation: Rotation, face: IntArray, kept: BoolArray
) -> list[list[IntArray]]:
    """
    Return the rings round faces or sets of them: per face its outer ring, counter-clockwise, then its holes.

    Rings are simple, begin at their first vertex, and are rows of vertices; a face without a ring of three
    vertices has none.

    Parameters
    ----------
    vertices : ndarray of shape (n_vertices, 2), int64
    edges : ndarray of shape (n_edges, 2), int64
    rotation : Rotation
    face : ndarray of shape (n_half_edges,), int64
        Face or set to the left of each half-edge, -1 = none.
    kept : ndarray of shape (n_vertices,), bool
        The vertices that rings show.
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


@inner_kernel
def _next(half, ends, first, order, place, face):  # type: ignore[no-untyped-def]
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
                half = _next(half, ends, first, order, place, face)
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


@inner_kernel
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
            half = _next(half, ends, first, order, place, face)
    return n
