"""Solids of roofs that overhang their walls: between two surfaces over the plan, with soffits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise

import numpy as np
import shapely

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.solids.half_edges import LEFT, LEVEL, START, HalfEdges, X, Y, level_of
from lidar_buildings.core.solids.output_grid import GRID, polygons_of
from lidar_buildings.core.solids.plan_graph import (
    LEAST_DISTANCE,
    RoofPiece,
    noded_coverage,
    rings_of,
    with_minimum_height,
)
from lidar_buildings.core.solids.planar_subdivision import OUTSIDE, PlanGraph
from lidar_buildings.core.solids.raising import triangulate_non_planar
from lidar_buildings.core.solids.shell import (
    GROUND_SURFACE,
    OUTER_CEILING_SURFACE,
    ROOF_SURFACE,
    WALL_SURFACE,
    Face,
    Solid,
)
from lidar_buildings.core.solids.validity import check_solid

#: Half-edges of a plan: where one starts and ends, the owner to its left.
_Edge = tuple[int, int, int]
#: Soffits and roofs of other parts at one place, no farther apart than this, meet [grid steps].
_MERGED = 4
#: Parts of a plan smaller than this are not told apart [m²].
_LEAST_AREA = 1e-4


def overhung_solid(
    pieces: Sequence[RoofPiece], walls: shapely.Geometry, ground_elevation: float, thickness: float
) -> tuple[Solid, tuple[int, ...]]:
    """
    Raise a roof that overhangs its walls, on the output grid; return it and what `check_solid` says.

    Pieces are those of `roof_solid`. Within the walls' plan, a polygon or several [m], the solid reaches from
    the ground to the roof; beyond, down to soffits parallel to the roof, `thickness` [m] below it vertically.
    Soffits are OuterCeilingSurface, all upright faces are WallSurface. Pieces beyond all
    walls stand on the ground.
    """
    ground, depth = round(ground_elevation / GRID), max(1, round(thickness / GRID))
    pieces = with_minimum_height(pieces, ground * GRID)
    cells, planes = _cells(pieces, walls)
    numbers = np.array([number for number, _ in cells], dtype=np.int64)
    graph = noded_coverage([piece for _, piece in cells], numbers, LEAST_DISTANCE, 1.0)
    for _ in range(2):
        plan = HalfEdges(graph, planes, ground)
        graph, is_split = _split_where_soffits_cross(plan, depth)
        if not is_split:
            break
    solid = _Shell(plan, ground, depth).solid()
    codes = check_solid(solid)
    if codes and {203, 204}.issuperset(codes) and not check_solid(cut := triangulate_non_planar(solid)):
        return cut, ()
    return solid, codes


def _cells(
    pieces: Sequence[RoofPiece], walls: shapely.Geometry
) -> tuple[list[tuple[int, RoofPiece]], FloatArray]:
    """Return the parts of pieces within the walls, numbered 2k, and beyond, 2k + 1, and a plane for each."""
    cells: list[tuple[int, RoofPiece]] = []
    for k, piece in enumerate(pieces):
        polygon = shapely.make_valid(shapely.Polygon(piece.rings[0], piece.rings[1:]))
        inner = polygon.intersection(walls)
        beside = shapely.union_all(polygons_of(inner)).buffer(GRID)
        for side, part in enumerate((inner, polygon.difference(walls))):
            for one in polygons_of(part):
                if one.area > _LEAST_AREA:
                    # What does not hang on walls under the same piece stands on the ground.
                    hangs = side and one.boundary.intersection(beside).length > 10.0 * GRID
                    cells.append((2 * k + bool(hangs), RoofPiece(rings_of(one), piece.plane)))
    return cells, np.array([piece.plane for piece in pieces], dtype=np.float64).reshape(-1, 3).repeat(
        2, axis=0
    )


def _split_where_soffits_cross(plan: HalfEdges, depth: int) -> tuple[PlanGraph, bool]:
    """Return a plan's graph with a vertex wherever one cell's soffit crosses the other one's roof."""
    places, edges = plan.vertices[:, [X, Y]].tolist(), plan.edges
    lines: list[tuple[tuple[int, int], tuple[int, int], int, int]] = []
    is_split = False
    for e in range(0, len(edges), 2):
        left, right = int(edges[e, LEFT]), int(edges[e + 1, LEFT])
        a, b = places[edges[e, START]], places[edges[e + 1, START]]
        if edges[e, START] == edges[e + 1, START]:
            continue
        cuts = []
        if left != OUTSIDE and right != OUTSIDE and (left % 2 or right % 2):
            steps = (
                edges[e, LEVEL] - level_of(edges, e, right),
                level_of(edges, e + 1, left) - edges[e + 1, LEVEL],
            )
            for offset, is_odd in ((depth, left % 2), (-depth, right % 2)):
                first, last = steps[0] - offset, steps[1] - offset
                if is_odd and first * last < 0:
                    cuts.append(first / (first - last))
        ends = [a]
        for share in sorted(cuts):
            place = [round(p + share * (q - p)) for p, q in zip(a, b, strict=True)]
            if place not in (ends[-1], b):
                ends.append(place)
                is_split = True
        ends.append(b)
        lines += [(tuple(p), tuple(q), left, right) for p, q in pairwise(ends)]
    return _graph(lines), is_split


def _graph(lines: Iterable[tuple[tuple[int, int], tuple[int, int], int, int]]) -> PlanGraph:
    """Return the graph of edges given as start, end, and what lies to the left and to the right."""
    rising = [(a, b, left, right) if a < b else (b, a, right, left) for a, b, left, right in lines]
    numbers = {place: k for k, place in enumerate(sorted({p for a, b, *_ in rising for p in (a, b)}))}
    rows = sorted((numbers[a], numbers[b], left, right) for a, b, left, right in rising)
    table = np.array(rows, dtype=np.int64).reshape(-1, 4)
    return PlanGraph(np.array(list(numbers), dtype=np.int64).reshape(-1, 2), table[:, :2], table[:, 2:])


class _Shell:
    """The faces between roof and soffits, with all vertices that meet above each place of a plan."""

    def __init__(self, plan: HalfEdges, ground: int, depth: int) -> None:
        self._places: IntArray = plan.vertices[:, [X, Y]]
        self._ground, self._depth = ground, depth
        edges = plan.edges
        self._edges: list[_Edge] = [
            (int(edges[e, START]), int(edges[e ^ 1, START]), int(edges[e, LEFT])) for e in range(len(edges))
        ]
        self._tops: dict[tuple[int, int], int] = {}
        for e, (start, _, piece) in enumerate(self._edges):
            if piece != OUTSIDE:
                self._tops[start, piece] = int(edges[e, LEVEL])
        self._levels: dict[int, set[int]] = {}
        for (vertex, _), top in self._tops.items():
            self._levels.setdefault(vertex, set()).add(top)
        self._bottoms = {key: self._bottom(*key) for key in self._tops}
        for (vertex, _), bottom in self._bottoms.items():
            self._levels[vertex].add(bottom)
        self._rows: dict[tuple[int, int], int] = {}

    def solid(self) -> Solid:
        """Return roof faces, the ground, soffits and upright faces as one shell."""
        faces: list[Face] = []
        kinds: list[str] = []
        for owner, face in self._flat_faces(lambda piece: piece // 2):
            faces.append(tuple(tuple(self._row(v, self._top(v, owner)) for v in ring) for ring in face))
            kinds.append(ROOF_SURFACE)
        for owner, face in self._flat_faces(lambda piece: piece if piece % 2 else 0):
            if owner % 2:
                under = [[self._row(v, self._ends(v, owner)[0]) for v in ring] for ring in face]
            else:
                under = [[self._row(v, self._ground) for v in ring] for ring in face]
            faces.append(tuple(tuple(ring[::-1]) for ring in under))
            kinds.append(OUTER_CEILING_SURFACE if owner % 2 else GROUND_SURFACE)
        for e in range(0, len(self._edges), 2):
            upright = [*self._upright(e, e + 1), *self._upright(e + 1, e)]
            faces += [(ring,) for ring in upright]
            kinds += [WALL_SURFACE] * len(upright)
        corners = np.array([(*self._places[v], level) for v, level in self._rows], dtype=np.float64)
        return Solid(corners.reshape(-1, 3) / round(1 / GRID), tuple(faces), tuple(kinds))

    def _row(self, vertex: int, level: int) -> int:
        return self._rows.setdefault((vertex, level), len(self._rows))

    def _top(self, vertex: int, roof: int) -> int:
        """Return the elevation of a roof face, of which a place has the inner part, the outer or both."""
        return next(self._tops[vertex, p] for p in (2 * roof, 2 * roof + 1) if (vertex, p) in self._tops)

    def _bottom(self, vertex: int, piece: int) -> int:
        """Return the lower end of what a cell holds; where a soffit meets another roof they are one."""
        if not piece % 2:
            return self._ground
        soffit = max(self._tops[vertex, piece] - self._depth, self._ground)
        nearest = min(sorted(self._levels[vertex]), key=lambda top: abs(top - soffit))
        return nearest if abs(nearest - soffit) <= _MERGED else soffit

    def _ends(self, vertex: int, piece: int) -> tuple[int, int]:
        return self._bottoms[vertex, piece], self._tops[vertex, piece]

    def _upright(self, one: int, other: int) -> list[tuple[int, ...]]:
        """Return the faces above an edge that close what lies to its left where the right holds nothing."""
        (a, b, left), (_, _, right) = self._edges[one], self._edges[other]
        if left == OUTSIDE:
            return []
        (low_a, high_a), (low_b, high_b) = self._ends(a, left), self._ends(b, left)
        spans = [((low_a, low_b), (high_a, high_b))]
        if right != OUTSIDE:
            (floor_a, roof_a), (floor_b, roof_b) = self._ends(a, right), self._ends(b, right)
            spans = [
                ((low_a, low_b), (min(high_a, floor_a), min(high_b, floor_b))),
                ((max(low_a, roof_a), max(low_b, roof_b)), (high_a, high_b)),
            ]
        rings = []
        for (low_a, low_b), (high_a, high_b) in spans:
            if high_a < low_a or high_b < low_b or (high_a == low_a and high_b == low_b):
                continue
            up_b = [level for level in sorted(self._levels[b]) if low_b <= level <= high_b]
            down_a = [level for level in sorted(self._levels[a], reverse=True) if low_a <= level <= high_a]
            ring = [self._row(a, low_a), *(self._row(b, z) for z in up_b), *(self._row(a, z) for z in down_a)]
            rings.append(tuple(ring[:-1] if ring[-1] == ring[0] else ring))
        return rings

    def _flat_faces(self, owner_of: Callable[[int], int]) -> list[tuple[int, list[list[int]]]]:
        """Return the faces in plan once pieces of one owner are joined: owner, exterior and holes."""
        owners = [OUTSIDE if piece == OUTSIDE else owner_of(piece) for _, _, piece in self._edges]
        kept = [e for e in range(len(owners)) if owners[e] != owners[e ^ 1]]
        fans: dict[int, list[int]] = {}
        for e in kept:
            fans.setdefault(self._edges[e][0], []).append(e)
        for fan in fans.values():
            fan.sort(key=self._direction)
        rings: dict[int, list[list[int]]] = {}
        done: set[int] = set()
        for first in kept:
            path: list[int] = []
            at: dict[int, int] = {}
            e = first
            while e not in done and owners[e] != OUTSIDE:
                start, end, _ = self._edges[e]
                done.add(e)
                at[start] = len(path)
                path.append(start)
                if end in at:  # a ring passes no place twice
                    rings.setdefault(owners[e], []).append(path[at[end] :])
                    for vertex in path[at[end] :]:
                        del at[vertex]
                    del path[len(path) - len(rings[owners[e]][-1]) :]
                    at = {vertex: k for k, vertex in enumerate(path)}
                fan = fans[end]
                e = fan[fan.index(e ^ 1) - 1]  # the next one clockwise from the way back
        return [(owner, face) for owner in sorted(rings) for face in self._with_holes(rings[owner])]

    def _direction(self, e: int) -> float:
        start, end, _ = self._edges[e]
        dx, dy = (self._places[end] - self._places[start]).tolist()
        return math.atan2(dy, dx)

    def _with_holes(self, rings: list[list[int]]) -> list[list[list[int]]]:
        """Return each exterior with the holes in it."""
        polygons = [shapely.Polygon(self._places[ring]) for ring in rings]
        is_exterior = [polygon.exterior.is_ccw for polygon in polygons]
        faces = {k: [rings[k]] for k in range(len(rings)) if is_exterior[k]}
        for k in range(len(rings)):
            if not is_exterior[k]:
                inside = polygons[k].representative_point()
                around = [m for m in faces if polygons[m].contains(inside)]
                if around:
                    faces[min(around, key=lambda m: polygons[m].area)].append(rings[k])
        return list(faces.values())
