"""Edges of a plan along which the roofs on both sides change places: divided where they cross."""

from __future__ import annotations

from itertools import product

from lidar_buildings.core.solids.raising.plan_graph import OUTSIDE, Vertex
from lidar_buildings.core.solids.raising.vertex_columns import VertexColumns


def split_crossings(columns: VertexColumns) -> bool:
    """Divide all edges where the profiles of their two pieces cross; say whether there was one."""
    changed = False
    for start, end in sorted(columns.graph.left):
        if start < end:
            changed |= _split_crossing(columns, start, end)
    return changed


def _split_crossing(columns: VertexColumns, start: Vertex, end: Vertex) -> bool:
    """Divide one edge if it has to be, and say whether it had."""
    left, right = columns.graph.left[start, end], columns.graph.left[end, start]
    if OUTSIDE in (left, right):
        return False
    steps = [columns.level(vertex, left) - columns.level(vertex, right) for vertex in (start, end)]
    if steps[0] * steps[1] >= 0:
        return False
    middle = _crossing(columns, start, end, left, right)
    if middle in columns.graph.around:
        return False
    columns.graph.split_edge(start, end, middle)
    columns.joined.add(middle)
    return True


def _crossing(columns: VertexColumns, start: Vertex, end: Vertex, left: int, right: int) -> Vertex:
    """Return the place of the grid next to the crossing at which both pieces differ least."""
    first, last = (columns.raw(vertex, left) - columns.raw(vertex, right) for vertex in (start, end))
    share = first / (first - last)
    exact = tuple(a + share * (b - a) for a, b in zip(start, end, strict=True))
    near = [
        (round(exact[0]) + dx, round(exact[1]) + dy)
        for dx, dy in sorted(product((-1, 0, 1), repeat=2), key=lambda d: d[0] ** 2 + d[1] ** 2)
    ]
    return min(near, key=lambda v: _misfit(columns, v, exact, left, right))


def _misfit(columns: VertexColumns, vertex: Vertex, exact: tuple[float, ...], left: int, right: int) -> float:
    """Weigh how far two pieces are apart at a place against how far it is from where it should be."""
    step = columns.raw(vertex, left) - columns.raw(vertex, right)
    return abs(step) + abs(vertex[0] - exact[0]) + abs(vertex[1] - exact[1])
