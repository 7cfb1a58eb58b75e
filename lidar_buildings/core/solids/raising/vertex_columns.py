"""Elevations at the vertices of a plan: one per piece that meets there, almost equal ones made one."""

from __future__ import annotations

from collections.abc import Sequence

from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.solids.raising.minimum_height import MIN_HEIGHT
from lidar_buildings.core.solids.raising.plan_graph import OUTSIDE, PlanGraph, Vertex
from lidar_buildings.core.solids.raising.roof_piece import RoofPiece

#: Elevations at one vertex within this become one: no face leaves its plane by more than half of it [m].
MERGE_TOLERANCE = 0.008


class VertexColumns:
    """
    The vertical lines above the vertices of a plan, and the elevations at which pieces meet them.

    Attributes
    ----------
    joined : set of Vertex
        Where all pieces have to meet in one elevation, however far apart they are.
    """

    def __init__(
        self,
        graph: PlanGraph,
        pieces: Sequence[RoofPiece],
        ground: int,
        merge_tolerance: float = MERGE_TOLERANCE,
    ) -> None:
        self.graph = graph
        self.pieces = pieces
        self.ground = ground
        self.merge_tolerance = merge_tolerance
        self.joined: set[Vertex] = set()
        self._levels: dict[Vertex, dict[int, int]] = {}

    def levels(self, vertex: Vertex) -> dict[int, int]:
        """Return the elevation of each piece at a vertex in steps of the grid, the ground's for OUTSIDE."""
        if vertex not in self._levels:
            self._levels[vertex] = self._measure(vertex)
        return self._levels[vertex]

    def level(self, vertex: Vertex, piece: int) -> int:
        """Return the elevation of one piece at a vertex in steps of the grid."""
        return self.levels(vertex)[piece]

    def stack(self, vertex: Vertex) -> list[int]:
        """Return all elevations at a vertex, rising."""
        return sorted(set(self.levels(vertex).values()))

    def forget(self, *vertices: Vertex) -> None:
        """Measure vertices anew when they are next asked for: other pieces meet there now."""
        for vertex in vertices:
            self._levels.pop(vertex, None)

    def raw(self, vertex: Vertex, piece: int) -> float:
        """Return the elevation of a piece's own plane at a vertex [steps of the grid]."""
        return self.pieces[piece].elevation(vertex[0] * GRID, vertex[1] * GRID) / GRID

    def _measure(self, vertex: Vertex) -> dict[int, int]:
        """Measure the elevations at a vertex and make almost equal ones one, from the lowest on."""
        found = self.graph.pieces_at(vertex)
        levels = {OUTSIDE: self.ground} if OUTSIDE in found else {}
        raw = sorted((self.raw(vertex, piece), piece) for piece in found if piece != OUTSIDE)
        within = float("inf") if vertex in self.joined else self.merge_tolerance / GRID
        first = 0
        for last in range(1, len(raw) + 1):
            if last == len(raw) or raw[last][0] - raw[first][0] > within:
                middle = round(0.5 * (raw[first][0] + raw[last - 1][0]))
                middle = max(middle, self.ground + round(MIN_HEIGHT / GRID))
                levels |= {piece: middle for _, piece in raw[first:last]}
                first = last
        return levels
