"""
The plan of a roof as a planar graph: which piece lies to the left of each directed edge.

Vertices are pairs of whole grid steps (millimetres), so that equal places are equal keys and nothing is
rounded twice.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence

import numpy as np

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.solids.raising.roof_piece import RoofPiece

#: A place in plan, in steps of the grid.
Vertex = tuple[int, int]
#: Stands for what lies beside all pieces.
OUTSIDE = -1


class PlanGraph:
    """
    Half-edges of a coverage: each edge of the plan in both directions, with what lies to its left.

    Attributes
    ----------
    left : dict of (Vertex, Vertex) to int
        Number of the piece to the left of each directed edge, OUTSIDE for none.
    around : dict of Vertex to list of Vertex
        Neighbours of each vertex, counter-clockwise.
    """

    def __init__(self, left: dict[tuple[Vertex, Vertex], int]) -> None:
        self.left = left
        neighbours = defaultdict(list)
        for start, end in left:
            neighbours[start].append(end)
        self.around = {vertex: _by_angle(vertex, ends) for vertex, ends in neighbours.items()}

    @property
    def area(self) -> int:
        """Twice the area of all pieces together [square steps of the grid]."""
        return sum(a[0] * b[1] - b[0] * a[1] for (a, b), piece in self.left.items() if piece != OUTSIDE)

    def sectors(self, vertex: Vertex) -> list[int]:
        """Return the pieces around a vertex: entry k lies between neighbours k and k + 1."""
        return [self.left[vertex, end] for end in self.around[vertex]]

    def pieces_at(self, vertex: Vertex) -> set[int]:
        """Return the pieces on both sides of all edges at a vertex."""
        ends = self.around[vertex]
        return {self.left[vertex, end] for end in ends} | {self.left[end, vertex] for end in ends}

    def split_edge(self, start: Vertex, end: Vertex, middle: Vertex) -> None:
        """Put a vertex into an edge."""
        for a, b in ((start, end), (end, start)):
            piece = self.left.pop((a, b))
            self.left[a, middle] = self.left[middle, b] = piece
            self.around[a] = _by_angle(a, [middle if v == b else v for v in self.around[a]])
        self.around[middle] = _by_angle(middle, [start, end])

    def cut_corner(self, vertex: Vertex, members: Sequence[int], apex: Vertex) -> None:
        """
        Draw consecutive sectors back from a vertex, so that those before and after them meet there.

        Parameters
        ----------
        vertex : Vertex
            Where the sectors end.
        members : sequence of int
            Their numbers as in `sectors`, counter-clockwise.
        apex : Vertex
            Where they end from now on.
        """
        ends = self.around[vertex]
        moved = [ends[k] for k in members] + [ends[(members[-1] + 1) % len(ends)]]
        before, after = self.left[moved[0], vertex], self.left[vertex, moved[-1]]
        for end in moved:
            self.left[apex, end] = self.left.pop((vertex, end))
            self.left[end, apex] = self.left.pop((end, vertex))
            self.around[end] = _by_angle(end, [apex if v == vertex else v for v in self.around[end]])
        kept = [end for end in ends if end not in moved]
        if before != after:
            self.left[vertex, apex], self.left[apex, vertex] = after, before
            kept, moved = [*kept, apex], [*moved, vertex]
        self.around[vertex] = _by_angle(vertex, kept)
        self.around[apex] = _by_angle(apex, moved)

    def rings(self) -> dict[int, list[list[Vertex]]]:
        """
        Return the rings around every piece and around what is outside, with the piece to their left.

        No ring passes a vertex twice: where a piece touches itself, its ring is divided. Nothing is returned
        if a ring has different pieces to its left: its edges cross.
        """
        following = {}
        for vertex, ends in self.around.items():
            for end, before in zip(ends, [ends[-1], *ends[:-1]], strict=True):
                following[end, vertex] = (vertex, before)
        found = defaultdict(list)
        pending = dict.fromkeys(sorted(self.left))
        while pending:
            edge = next(iter(pending))
            piece, ring = self.left[edge], []
            while edge in pending:
                if self.left[edge] != piece:
                    return {}
                del pending[edge]
                ring.append(edge[0])
                edge = following[edge]
            found[piece].extend(_simple_rings(ring))
        return found


def labelled_graph(faces: Sequence[tuple[int, list[list[Vertex]]]]) -> PlanGraph | None:
    """
    Return the graph of faces (number of the piece, rings), None if two of them claim the same edge.

    Edges between faces of the same piece are left out.
    """
    left: dict[tuple[Vertex, Vertex], int] = {}
    for piece, rings in faces:
        for ring in rings:
            for edge in zip(ring, ring[1:] + ring[:1], strict=True):
                if edge in left:
                    return None
                left[edge] = piece
    for start, end in list(left):
        left.setdefault((end, start), OUTSIDE)
    return PlanGraph({edge: piece for edge, piece in left.items() if left[edge[::-1]] != piece})


def piece_rings(piece: RoofPiece) -> list[list[Vertex]]:
    """Return the rings of a piece in steps of the grid, none if its exterior has no area."""
    rings = [grid_ring(ring / GRID, ccw=k == 0) for k, ring in enumerate(piece.rings)]
    return [ring for ring in rings if ring] if rings and rings[0] else []


def grid_ring(ring: FloatArray, *, ccw: bool) -> list[Vertex]:
    """Return a ring given in steps of the grid in the direction asked for, without repetitions and spikes."""
    corners: list[Vertex] = []
    for corner in map(tuple, np.rint(ring).astype(np.int64).tolist()):
        _append(corners, corner)
    while len(corners) > 2:
        if corners[-1] == corners[0] or corners[-2] == corners[0]:
            corners.pop()
        elif corners[-1] == corners[1]:
            del corners[0]
        else:
            break
    if len(corners) < 3:
        return []
    return corners if (doubled_area(corners) > 0) == ccw else corners[::-1]


def doubled_area(ring: Sequence[Vertex]) -> int:
    """Twice the area inside a ring in square steps of the grid, exact; positive if counter-clockwise."""
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(ring, [*ring[1:], *ring[:1]], strict=True))


def _append(corners: list[Vertex], corner: Vertex) -> None:
    """
    Add a corner to a ring unless it repeats the last one; going back along the last edge takes that back.
    """
    if corners and corners[-1] == corner:
        return
    if len(corners) > 1 and corners[-2] == corner:
        corners.pop()
        return
    corners.append(corner)


def _by_angle(vertex: Vertex, ends: Iterable[Vertex]) -> list[Vertex]:
    """Return the neighbours of a vertex counter-clockwise, from the direction of −x on."""
    return sorted(ends, key=lambda end: math.atan2(end[1] - vertex[1], end[0] - vertex[0]))


def _simple_rings(ring: list[Vertex]) -> list[list[Vertex]]:
    """Divide a ring where it passes a vertex a second time."""
    if len(set(ring)) == len(ring):
        return [ring]
    rings: list[list[Vertex]] = []
    path: list[Vertex] = []
    place: dict[Vertex, int] = {}
    for vertex in ring:
        if vertex in place:
            rings.append(path[place[vertex] :])
            for dropped in rings[-1][1:]:
                del place[dropped]
            path = path[: place[vertex] + 1]
        else:
            place[vertex] = len(path)
            path.append(vertex)
    return [*rings, path]
