"""What buildings and obstacles consist of: roofs, walls with windows, doors and arcades, eaves."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import IntEnum
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.simulation.building import Building, Opening, RoofFace, Wall, walls_of


class SurfaceKind(IntEnum):
    """What a point lies on: the extra dimension `TrueKind`."""

    OTHER = 0  #: gross errors
    TERRAIN = 1
    ROOF = 2
    WALL = 3
    WINDOW = 4  #: the pane
    DOOR = 5
    REVEAL = 6  #: what is between the face of a wall and a pane or a leaf
    EAVE = 7  #: edge and underside of what hangs over
    CEILING = 8  #: of an arcade
    INTERIOR = 9  #: behind a pane: a room, or a wall from within
    TREE = 10
    HEDGE = 11
    FENCE = 12
    GARDEN_WALL = 13
    VEHICLE = 14
    POLE = 15
    PERSON = 16
    PAVEMENT = 17  #: with the kerb


#: What obstacles are, by their `roof_type`.
OBSTACLES = {
    "car": SurfaceKind.VEHICLE,
    "lorry": SurfaceKind.VEHICLE,
    "wall": SurfaceKind.GARDEN_WALL,
    "hedge": SurfaceKind.HEDGE,
    "fence": SurfaceKind.FENCE,
    "pole": SurfaceKind.POLE,
    "person": SurfaceKind.PERSON,
    "pavement": SurfaceKind.PAVEMENT,
}
#: Thickness of an arcade's piers, and of the ends of what is behind it [m].
PIER = 0.5
#: Walls within a building begin at this distance inside the outline when it is asked under which roof [m].
INWARDS = 1e-3
#: Spans of a wall under one roof face are longer [m].
SHORTEST_SPAN = 0.01
#: A room is wider and higher than its window by this on each side [m].
ROOM = 1.0
#: A side of a roof is a verge if it rises by more than this [m].
LEVEL = 0.05


@dataclass(frozen=True)
class Part:
    """A wall, an opening or an eave, whose points are counted."""

    layer: str  #: ``"walls"``, ``"openings"`` or ``"eaves"``
    kind: str
    building: int
    #: Ends in plan, of an opening those of the pane, of an eave those of its edge [m].
    start: tuple[float, float]
    end: tuple[float, float]
    #: Lowest and highest elevation; of an eave the upper edge's at its start and at its end [m].
    low: float
    high: float
    wall: int = -1  #: row of the wall of an opening or under an eave
    depth: float = 0.0  #: of an opening behind the wall, of an eave's edge before it [m]
    thickness: float = 0.0  #: of an eave, along z [m]

    @property
    def length(self) -> float:
        """In plan [m]."""
        return float(np.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]))


@dataclass(frozen=True)
class Panel:
    """A vertical surface that is seen from both sides."""

    start: tuple[float, float]  #: [m]
    end: tuple[float, float]
    bottom: tuple[float, float]  #: elevations at the start and at the end [m]
    top: tuple[float, float]
    surface: SurfaceKind
    part: int = -1  #: row of the part to which it belongs; −1 for none
    is_grounded: bool = False  #: whether it goes on into the ground


@dataclass(frozen=True, eq=False)
class Slab:
    """A surface that is seen from above or from below."""

    face: RoofFace
    surface: SurfaceKind
    part: int = -1
    plane_id: int = 0  #: of a roof face, from 1
    side: float = 1.0  #: 1: seen from above; −1: from below


@dataclass
class Parts:
    """The surfaces of a building or obstacle, and its parts."""

    panels: list[Panel] = field(default_factory=list)
    slabs: list[Slab] = field(default_factory=list)
    parts: list[Part] = field(default_factory=list)

    def add(self, part: Part) -> int:
        """Append a part; its row."""
        self.parts.append(part)
        return len(self.parts) - 1


def parts_of(building: Building) -> Parts:
    """Return what a building or an obstacle consists of."""
    made = Parts()
    surface = OBSTACLES[building.roof_type] if building.number == 0 else SurfaceKind.ROOF
    for plane_id, face in enumerate(building.faces, start=1):
        made.slabs.append(Slab(face, surface, plane_id=plane_id))
    if building.number == 0:
        for wall in walls_of(building):
            bottom = tuple(np.add(wall.bottom, building.clearance if wall.outer else 0.0))
            is_grounded = wall.outer and not building.clearance
            made.panels.append(Panel(wall.start, wall.end, bottom, wall.top, surface, -1, is_grounded))
    elif building.overhangs or building.openings:
        _Facades(building, made).build()
    else:
        _build_plain(building, made)
    return made


def _build_plain(building: Building, made: Parts) -> None:
    """Walls under the rim of the roof, one part under each edge of the outline."""
    edges = _edges_of(building)
    walls = walls_of(building)
    of_edge = _nearest_edges(walls, edges)
    foot = building.ground_elevation
    for row, (start, end) in enumerate(edges):
        high = max((max(w.top) for w, one in zip(walls, of_edge, strict=True) if one == row), default=foot)
        made.add(Part("walls", _wall_kind(building, edges, row), building.number, start, end, foot, high))
    for wall, row in zip(walls, of_edge, strict=True):
        part = row if wall.outer else _step(building, wall, made)
        made.panels.append(
            Panel(wall.start, wall.end, wall.bottom, wall.top, SurfaceKind.WALL, part, wall.outer)
        )


def _step(building: Building, wall: Wall, made: Parts) -> int:
    """Add a wall on a lower roof; its row."""
    low, high = min(wall.bottom), max(wall.top)
    return made.add(Part("walls", "step", building.number, wall.start, wall.end, low, high))


Edge = tuple[tuple[float, float], tuple[float, float]]


def _edges_of(building: Building) -> list[Edge]:
    """The edges of all rings of the outline."""
    return [
        ((float(a[0]), float(a[1])), (float(b[0]), float(b[1])))
        for ring in building.outline.rings
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True)
    ]


def _nearest_edges(walls: list[Wall], edges: list[Edge]) -> list[int]:
    """The edge of the outline over which each wall stands; −1 for walls on roofs."""
    lines = shapely.linestrings(np.array(edges))
    middles = shapely.points(np.array([np.add(wall.start, wall.end) / 2 for wall in walls]))
    nearest = shapely.distance(middles[:, None], lines[None]).argmin(axis=1)
    return [int(row) if wall.outer else -1 for wall, row in zip(walls, nearest, strict=True)]


def _wall_kind(building: Building, edges: list[Edge], row: int) -> str:
    """``"curved"`` for one of many short edges, else ``"wall"``."""
    is_curved = building.roof_type in {"round_tower", "curved_front"} and _length(edges[row]) < 3.5
    return "curved" if is_curved else "wall"


def _length(edge: Edge) -> float:
    return float(np.hypot(edge[1][0] - edge[0][0], edge[1][1] - edge[0][1]))


def set_back(ring: NDArray[np.float64], distances: tuple[float, ...]) -> NDArray[np.float64]:
    """Return a counter-clockwise ring whose edges lie inside by a distance each, shape (n, 2) [m]."""
    along = np.roll(ring, -1, axis=0) - ring
    along /= np.hypot(*along.T)[:, None]
    inward = np.column_stack([-along[:, 1], along[:, 0]])
    offset = np.array(distances)
    before = np.roll(np.arange(len(ring)), 1)
    # a corner lies on the lines of both its edges
    turn = along[before, 0] * along[:, 1] - along[before, 1] * along[:, 0]
    cos = (inward * inward[before]).sum(axis=1)
    shift = ((offset[before] - offset * cos) / turn)[:, None]
    return np.asarray(ring + offset[:, None] * inward + shift * along)


@dataclass
class _Span:
    """A piece of a wall under one roof face."""

    begin: float  #: along the wall [m]
    end: float
    top: tuple[float, float]  #: elevations [m]

    def at(self, along: float) -> float:
        """Elevation of its top."""
        share = (along - self.begin) / (self.end - self.begin)
        return self.top[0] + share * (self.top[1] - self.top[0])


class _Front:
    """A straight wall with openings; places on it are told by how far along and how deep behind they are."""

    def __init__(self, start: NDArray[np.float64], end: NDArray[np.float64], foot: float) -> None:
        self.length = float(np.hypot(*(end - start)))
        self.foot = foot
        self._start, self._along = start, (end - start) / self.length
        self._inward = np.array([-self._along[1], self._along[0]])

    def at(self, along: float, depth: float = 0.0) -> tuple[float, float]:
        """Return a position in plan [m]."""
        x, y = self._start + along * self._along + depth * self._inward
        return float(x), float(y)

    def panel(
        self,
        ends: tuple[tuple[float, float], tuple[float, float]],
        heights: tuple[float, float],
        surface: SurfaceKind,
        part: int = -1,
    ) -> Panel:
        """Return a panel between two places (along, depth) and two heights above the foot."""
        low, high = (self.foot + height for height in heights)
        return Panel(self.at(*ends[0]), self.at(*ends[1]), (low, low), (high, high), surface, part)

    def slab(
        self, span: tuple[float, float], depth: float, height: float, surface: SurfaceKind, side: float
    ) -> Slab:
        """Return a level surface from the face of the wall inwards."""
        corners = [(span[0], 0.0), (span[1], 0.0), (span[1], depth), (span[0], depth)]
        ring = np.array([self.at(*corner) for corner in corners])
        return Slab(RoofFace((ring,), (0.0, 0.0, self.foot + height)), surface, side=side)


class _Facades:
    """Builds the walls and eaves of a building with details."""

    def __init__(self, building: Building, made: Parts) -> None:
        self._building, self._made = building, made
        self._ring = building.exterior
        overhangs = building.overhangs or (0.0,) * len(self._ring)
        self._overhangs = overhangs
        self._wall_ring = set_back(self._ring, overhangs)
        self._edges = _edges_of(building)

    def build(self) -> None:
        """Add all panels, slabs and parts."""
        building, made = self._building, self._made
        walls = walls_of(building)
        of_edge = _nearest_edges(walls, self._edges)
        n_outer = len(self._ring)
        for row in range(n_outer):
            rims = [wall for wall, one in zip(walls, of_edge, strict=True) if one == row]
            self._build_front(row, rims)
        rows: dict[int, int] = {}
        for wall, edge in zip(walls, of_edge, strict=True):
            if 0 <= edge < n_outer:
                continue
            if edge < 0:
                part = _step(building, wall, made)
            else:
                part = rows.setdefault(edge, len(made.parts))
                if part == len(made.parts):
                    low, high = building.ground_elevation, max(wall.top)
                    made.add(Part("walls", "wall", building.number, *self._edges[edge], low, high))
            made.panels.append(
                Panel(wall.start, wall.end, wall.bottom, wall.top, SurfaceKind.WALL, part, wall.outer)
            )

    def _build_front(self, row: int, rims: list[Wall]) -> None:
        building, made = self._building, self._made
        start, end = self._wall_ring[row], self._wall_ring[(row + 1) % len(self._wall_ring)]
        front = _Front(start, end, building.ground_elevation)
        spans = self._spans(front)
        kind = _wall_kind(building, self._edges, row)
        high = max(max(span.top) for span in spans)
        ends = front.at(0.0), front.at(front.length)
        wall = made.add(Part("walls", kind, building.number, *ends, front.foot, high))
        openings = [one for one in building.openings if one.edge == row]
        made.panels += _pieces(front, spans, openings, wall)
        bays = [one for one in openings if one.kind == "arcade"]
        if bays:
            self._build_arcade(front, bays)
        for opening in openings:
            if opening.kind != "arcade":
                self._build_opening(front, opening, wall)
        self._build_eave(row, rims, wall)

    def _spans(self, front: _Front) -> list[_Span]:
        """Under which roof faces the wall stands, from its start to its end."""
        line = shapely.LineString([front.at(0.0, INWARDS), front.at(front.length, INWARDS)])
        ends = np.array([front.at(0.0), front.at(front.length)])
        found = []
        for face in self._building.faces:
            for piece in shapely.get_parts(shapely.intersection(line, face.polygon)):
                if piece.length > SHORTEST_SPAN:
                    first, last = (shapely.get_coordinates(piece)[k] for k in (0, -1))
                    begin, end = sorted(float(np.hypot(*(one - ends[0]))) for one in (first, last))
                    found.append((begin, end, face))
        found.sort(key=lambda one: one[0])
        cuts = [0.0, *((one[1] + other[0]) / 2 for one, other in pairwise(found)), front.length]
        spans = []
        for (begin, end), (_, _, face) in zip(pairwise(cuts), found, strict=True):
            top = face.elevation(np.array([front.at(begin), front.at(end)])) - self._building.roof_thickness
            spans.append(_Span(begin, end, (float(top[0]), float(top[1]))))
        return spans

    def _build_opening(self, front: _Front, opening: Opening, wall: int) -> None:
        """A pane or a leaf, what is between it and the face of the wall, and the room behind a pane."""
        made, heights = self._made, (opening.bottom, opening.top)
        span, depth = (opening.along, opening.along + opening.width), opening.depth
        ends = front.at(span[0], depth), front.at(span[1], depth)
        low, high = front.foot + opening.bottom, front.foot + opening.top
        part = made.add(
            Part("openings", opening.kind, self._building.number, *ends, low, high, wall, depth=depth)
        )
        surface = SurfaceKind.WINDOW if opening.kind == "window" else SurfaceKind.DOOR
        made.panels.append(front.panel(((span[0], depth), (span[1], depth)), heights, surface, part))
        made.panels += [
            front.panel(((along, 0.0), (along, depth)), heights, SurfaceKind.REVEAL) for along in span
        ]
        made.slabs.append(front.slab(span, depth, opening.bottom, SurfaceKind.REVEAL, 1.0))
        made.slabs.append(front.slab(span, depth, opening.top, SurfaceKind.REVEAL, -1.0))
        if opening.kind == "window":
            behind = depth + opening.room
            wide = (max(span[0] - ROOM, 0.0), behind), (min(span[1] + ROOM, front.length), behind)
            tall = max(opening.bottom - ROOM, 0.0), opening.top + ROOM / 2
            made.panels.append(front.panel(wide, tall, SurfaceKind.INTERIOR))

    def _build_arcade(self, front: _Front, bays: list[Opening]) -> None:
        """Piers, the wall behind them, the ends, the ceiling and the floor between."""
        made, depth, heights = self._made, bays[0].depth, (bays[0].bottom, bays[0].top)
        bays = sorted(bays, key=lambda one: one.along)
        span = max(bays[0].along - PIER, 0.0), min(bays[-1].along + bays[-1].width + PIER, front.length)
        walls = [(span[0], 0.0), (span[0], depth), (span[1], depth), (span[1], 0.0)]
        low, high = front.foot + heights[0], front.foot + heights[1]
        for ends in pairwise(walls):
            part = made.add(
                Part("walls", "arcade", self._building.number, *(front.at(*one) for one in ends), low, high)
            )
            made.panels.append(front.panel(ends, heights, SurfaceKind.WALL, part))
        sides = [span[0]]
        for bay in bays:
            sides += [bay.along, bay.along + bay.width]
            made.panels += [
                front.panel(((along, 0.0), (along, PIER)), heights, SurfaceKind.REVEAL)
                for along in sides[-2:]
            ]
        sides.append(span[1])
        for ends in zip(sides[::2], sides[1::2], strict=True):
            made.panels.append(front.panel(((ends[0], PIER), (ends[1], PIER)), heights, SurfaceKind.REVEAL))
        made.slabs.append(front.slab(span, depth, heights[1], SurfaceKind.CEILING, -1.0))
        made.slabs.append(front.slab(span, depth, heights[0], SurfaceKind.PAVEMENT, 1.0))

    def _build_eave(self, row: int, rims: list[Wall], wall: int) -> None:
        """Edge and underside of what hangs over one wall."""
        building, made, thickness = self._building, self._made, self._building.roof_thickness
        if not thickness:
            return
        following = (row + 1) % len(self._ring)
        over = self._overhangs[row]
        rows: list[int] = []
        for rim in rims:
            part, surface = wall, SurfaceKind.WALL
            if over:
                kind = "verge" if abs(rim.top[1] - rim.top[0]) > LEVEL else "eave"
                place = (*(rim.start, rim.end), *rim.top)
                part = made.add(Part("eaves", kind, building.number, *place, wall, over, thickness))
                surface = SurfaceKind.EAVE
                rows.append(part)
            bottom = rim.top[0] - thickness, rim.top[1] - thickness
            made.panels.append(Panel(rim.start, rim.end, bottom, rim.top, surface, part))
        if not over:
            return
        corners = [self._ring[row], self._ring[following], self._wall_ring[following], self._wall_ring[row]]
        under = shapely.Polygon(corners)
        for face in building.faces:
            for piece in shapely.get_parts(shapely.intersection(under, face.polygon)):
                if isinstance(piece, shapely.Polygon) and piece.area > 1e-4:
                    a, b, c = face.plane
                    ring = shapely.get_coordinates(piece.exterior)[:-1]
                    middle = piece.representative_point()
                    nearest = min(
                        rows,
                        key=lambda one: shapely.LineString(
                            [made.parts[one].start, made.parts[one].end]
                        ).distance(middle),
                    )
                    lower = RoofFace((ring,), (a, b, c - thickness))
                    made.slabs.append(Slab(lower, SurfaceKind.EAVE, nearest, side=-1.0))


def _pieces(front: _Front, spans: list[_Span], openings: list[Opening], wall: int) -> list[Panel]:
    """The wall around its openings, in strips from opening to opening and from roof face to roof face."""
    sides = [side for one in openings for side in (one.along, one.along + one.width)]
    cuts = sorted({0.0, front.length, *sides, *(span.begin for span in spans)})
    panels = []
    for begin, end in pairwise(cuts):
        middle = (begin + end) / 2
        span = next(one for one in spans if one.begin <= middle <= one.end)
        over = sorted((one.bottom, one.top) for one in openings if one.along < middle < one.along + one.width)
        low, is_grounded = front.foot, True
        ends = front.at(begin), front.at(end)
        for bottom, top in over:
            high = front.foot + bottom
            if is_grounded or high > low:
                made = (low, low), (high, high), SurfaceKind.WALL, wall, is_grounded
                panels.append(Panel(*ends, *made))
            low, is_grounded = front.foot + top, False
        tops = span.at(begin), span.at(end)
        panels.append(Panel(*ends, (low, low), tops, SurfaceKind.WALL, wall, is_grounded))
    return panels


#: Height of a storey, of a window's sill above its floor, and of a window and a door [m].
STOREY, SILL, WINDOW, DOOR = 2.8, 0.9, 1.4, 2.1
#: What stays between an opening and the eave or the end of a wall [m].
MARGIN = 0.3
#: Shorter walls have no windows [m].
SHORTEST_FRONT = 2.4
#: So much of a wall touches a neighbour, and it is a party wall [m].
TOUCHING = 0.5
#: Roofs that hang over.
WITH_EAVES = frozenset(
    {
        "flat",
        "gable",
        "hip",
        "shed",
        "l_shape",
        "t_shape",
        "step",
        "dormer",
        "pyramid",
        "half_hip",
        "gable_dormer",
    }
)


def furnished(
    buildings: list[Building], streets: shapely.Geometry, random: np.random.Generator
) -> list[Building]:
    """
    Return buildings with eaves, where the roof is of that kind, windows, and a door to the nearest street.

    Arcades are kept.
    """
    tree = shapely.STRtree([building.polygon for building in buildings])
    made = []
    for building in buildings:
        near = [buildings[k] for k in tree.query(building.polygon.buffer(0.1))]
        made.append(_furnished(building, near, streets, random))
    return made


def _furnished(
    building: Building, near: list[Building], streets: shapely.Geometry, random: np.random.Generator
) -> Building:
    over = round(float(random.uniform(0.3, 0.8)), 2)
    verge = round(float(random.uniform(0.1, 0.4)), 2)
    thickness = round(float(random.uniform(0.15, 0.3)), 2)
    others = shapely.union_all([one.polygon for one in near if one.number != building.number]).buffer(0.05)
    edges = _edges_of(building)[: len(building.exterior)]
    lines = [shapely.LineString(edge) for edge in edges]
    is_free = [shapely.intersection(line, others).length < TOUCHING for line in lines]
    if building.roof_type in WITH_EAVES and not building.openings:
        rims = _rims(building)
        overhangs = tuple(
            (over if rim < LEVEL else min(verge, over)) if free else 0.0
            for rim, free in zip(rims, is_free, strict=True)
        )
        building = replace(building, overhangs=overhangs, roof_thickness=thickness)
    # the first one gets the door
    fronts = [row for row in range(len(edges)) if is_free[row] and _length(edges[row]) > SHORTEST_FRONT]
    fronts.sort(key=lambda row: (shapely.distance(lines[row].centroid, streets), -lines[row].length))
    return replace(building, openings=(*building.openings, *_openings(building, fronts, random)))


def _rims(building: Building) -> list[float]:
    """By how much the roof rises and falls along each edge of the outer ring [m]."""
    walls = walls_of(building)
    of_edge = _nearest_edges(walls, _edges_of(building))
    rims = []
    for row in range(len(building.exterior)):
        tops = [z for wall, one in zip(walls, of_edge, strict=True) if one == row for z in wall.top]
        rims.append(max(tops) - min(tops))
    return rims


def _openings(building: Building, fronts: list[int], random: np.random.Generator) -> list[Opening]:
    """Windows in rows and columns in these walls, and a door in the first one."""
    ring = set_back(building.exterior, building.overhangs or (0.0,) * len(building.exterior))
    front_lengths = np.hypot(*(np.roll(ring, -1, axis=0) - ring).T)
    depth, door_depth = (round(float(random.uniform(0.1, 0.2)), 2) for _ in range(2))
    width, pitch = float(random.uniform(0.9, 1.3)), float(random.uniform(2.2, 3.2))
    arcades = {one.edge: one.top for one in building.openings}
    found: list[Opening] = []
    for place, row in enumerate(fronts):
        length = float(front_lengths[row])
        start, end = ring[row], ring[(row + 1) % len(ring)]
        height = _lowest_top(building, start, end) - building.ground_elevation
        n_columns = max(1, int((length - 2 * MARGIN) / pitch))
        middles = (np.arange(n_columns) + 0.5) * length / n_columns
        first = arcades.get(row, 0.0)
        for number, middle in enumerate(middles):
            along = float(middle) - width / 2
            for storey in range(int(height / STOREY) + 1):
                bottom = STOREY * storey + SILL
                is_door = place == 0 and storey == 0 and number == n_columns // 2 and not arcades
                top = DOOR if is_door else bottom + WINDOW
                if bottom < first or top > height - MARGIN:
                    continue
                room = round(float(random.uniform(0.5, 1.5)), 2)
                kind, low, behind = ("door", 0.0, door_depth) if is_door else ("window", bottom, depth)
                found.append(Opening(kind, row, along, width, low, top, behind, room))
    return found


def _lowest_top(building: Building, start: NDArray[np.float64], end: NDArray[np.float64]) -> float:
    """The lowest elevation of a wall's top, wherever along it."""
    shares = np.linspace(0.02, 0.98, 25)[:, None]
    along = (end - start) / np.hypot(*(end - start))
    inward = INWARDS * np.array([-along[1], along[0]])
    _, tops = building.roof_at(start + shares * (end - start) + inward)
    return float(np.nanmin(tops)) - building.roof_thickness
