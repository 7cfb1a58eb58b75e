"""
Vertices at which four walls would meet: high and low pieces in turns around one vertex of the plan.

A shell must not touch itself (ISO 19107; val3dity's code 303). Around a vertex the elevations, taken in a
circle, may therefore rise once and fall once. Where they do so twice, the pieces of one valley are drawn
back by a centimetre, so that the higher ones beside it meet.
"""

from __future__ import annotations

import math

from lidar_buildings.core.solids.raising.plan_graph import Vertex
from lidar_buildings.core.solids.raising.vertex_columns import VertexColumns

#: How far a valley's tip is drawn back, in steps of the grid.
DRAWN_BACK = 10
#: Tips of narrow valleys are drawn back further, up to so many times.
_MAX_FACTOR = 4.0


def make_manifold(columns: VertexColumns) -> bool:
    """Draw valleys back until no vertex of the plan joins four walls; say whether one did."""
    changed = False
    for vertex in sorted(columns.graph.around):
        valley = _valley_to_cut(columns, vertex)
        if valley:
            changed |= _draw_back(columns, vertex, valley)
    return changed


def _valley_to_cut(columns: VertexColumns, vertex: Vertex) -> list[int]:
    """Return the sectors, counter-clockwise, of the shallowest valley to cut, none if the vertex is sound."""
    sectors = columns.graph.sectors(vertex)
    if len(sectors) < 4:
        return []
    heights = [columns.level(vertex, piece) for piece in sectors]
    for level in sorted(set(heights), reverse=True)[1:]:
        valleys = _valleys(heights, level)
        if len(valleys) > 1:
            return max(valleys, key=lambda valley: (min(heights[k] for k in valley), -valley[0]))
    return []


def _valleys(heights: list[int], level: int) -> list[list[int]]:
    """Return the runs of sectors not above a level, in a circle."""
    n = len(heights)
    starts = [k for k in range(n) if heights[k] <= level < heights[k - 1]]
    runs = []
    for start in starts:
        run = [start]
        while heights[(run[-1] + 1) % n] <= level:
            run.append((run[-1] + 1) % n)
        runs.append(run)
    return runs


def _draw_back(columns: VertexColumns, vertex: Vertex, valley: list[int]) -> bool:
    """Move the tip of a valley away from a vertex."""
    ends = columns.graph.around[vertex]
    first, last = ends[valley[0]], ends[(valley[-1] + 1) % len(ends)]
    apex = _apex(vertex, first, last)
    if apex in columns.graph.around:
        return False
    columns.graph.cut_corner(vertex, valley, apex)
    columns.forget(vertex)
    return True


def _apex(vertex: Vertex, first: Vertex, last: Vertex) -> Vertex:
    """Return the place on the bisector between two edges, the first one clockwise of the second."""
    angles = [math.atan2(end[1] - vertex[1], end[0] - vertex[0]) for end in (first, last)]
    half = 0.5 * ((angles[1] - angles[0]) % (2.0 * math.pi) or 2.0 * math.pi)
    reach = DRAWN_BACK * min(_MAX_FACTOR, 1.0 / max(math.sin(min(half, 0.5 * math.pi)), 1e-9))
    shortest = min(math.dist(vertex, first), math.dist(vertex, last))
    reach = min(reach, 0.4 * shortest)
    bisector = angles[0] + half
    return (
        round(vertex[0] + reach * math.cos(bisector)),
        round(vertex[1] + reach * math.sin(bisector)),
    )
