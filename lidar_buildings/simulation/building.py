"""A building as plane roof faces over a partition of its outline, and the closed shell under them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.outline import Outline

#: Faces meet on this grid [m]: far finer than any noise, far coarser than float64.
GRID = 1e-4


@dataclass(frozen=True, eq=False)
class RoofFace:
    """One plane piece of roof: z = a·x + b·y + c over a polygon."""

    rings: tuple[NDArray[np.float64], ...]  #: as those of an `Outline`
    plane: tuple[float, float, float]  #: a, b [m/m] and c [m]

    @cached_property
    def polygon(self) -> shapely.Polygon:
        """The face seen from above."""
        return shapely.Polygon(self.rings[0], self.rings[1:])

    @property
    def normal(self) -> NDArray[np.float64]:
        """Upward unit normal."""
        a, b, _ = self.plane
        return np.array([-a, -b, 1.0]) / np.sqrt(a * a + b * b + 1.0)

    @property
    def rings_3d(self) -> tuple[NDArray[np.float64], ...]:
        """The rings on the plane, each of shape (n_vertices, 3) [m]."""
        return tuple(np.column_stack([ring, self.elevation(ring)]) for ring in self.rings)

    def elevation(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Elevation of the plane [m] at positions of shape (n, 2)."""
        a, b, c = self.plane
        return np.asarray(a * xy[:, 0] + b * xy[:, 1] + c)

    def moved(self, x: float, y: float, angle: float = 0.0, elevation: float = 0.0) -> RoofFace:
        """Return the face turned counter-clockwise about the origin [rad], then moved [m]."""
        a, b = _turned(np.array(self.plane[:2]), angle)
        rings = tuple(_turned(ring, angle) + np.array([x, y]) for ring in self.rings)
        return RoofFace(rings, (float(a), float(b), float(self.plane[2] + elevation - a * x - b * y)))


@dataclass(frozen=True)
class Opening:
    """A window, a door or a bay of an arcade in the wall under one edge of the outline."""

    kind: str  #: ``"window"``, ``"door"`` or ``"arcade"``
    edge: int  #: row of the outer ring's vertex at which the edge starts
    along: float  #: from the start of the wall to the opening [m]
    width: float  #: [m]
    bottom: float  #: above the foot of the wall [m]
    top: float  #: above the foot of the wall [m]
    depth: float  #: of the pane, door leaf or inner wall behind the face of the wall [m]
    room: float = 1.0  #: from the pane to what is seen through it [m]


@dataclass(frozen=True, eq=False)
class Building:
    """
    A building whose walls stand under the rim of its roof, or behind it by what the roof hangs over.

    Cars, fences and the like are shaped as buildings, too.
    """

    #: ``"gable"``, ``"hip"``, … as the functions of `lidar_buildings.simulation.roof_shapes` are called.
    roof_type: str
    faces: tuple[RoofFace, ...]  #: they partition the outline; face i has plane id i + 1
    outline: Outline  #: the roofprint, without vertices in the middle of straight edges [m]
    ground_elevation: float = 0.0  #: elevation of the foot of the walls [m]
    number: int = 1  #: from 1 within a scene
    #: How far the roof hangs over the wall under each edge of the outer ring [m]; empty for nowhere.
    overhangs: tuple[float, ...] = ()
    roof_thickness: float = 0.0  #: of what hangs over, along z [m]
    openings: tuple[Opening, ...] = ()
    clearance: float = 0.0  #: between the ground and the sides, as under a car [m]

    @cached_property
    def polygon(self) -> shapely.Polygon:
        """The roofprint."""
        return self.outline.polygon

    @property
    def exterior(self) -> NDArray[np.float64]:
        """The outer ring, counter-clockwise, open, shape (n_vertices, 2) [m]."""
        return self.outline.exterior

    @property
    def planes(self) -> NDArray[np.float64]:
        """a, b, c of each face, shape (n_faces, 3)."""
        return np.array([face.plane for face in self.faces])

    @cached_property
    def roof_elevation_range(self) -> tuple[float, float]:
        """Elevation of the lowest and of the highest roof vertex [m]."""
        z = np.concatenate([ring[:, 2] for face in self.faces for ring in face.rings_3d])
        return float(z.min()), float(z.max())

    @property
    def height(self) -> float:
        """Highest roof vertex above the foot of the walls [m]."""
        return self.roof_elevation_range[1] - self.ground_elevation

    def roof_at(self, xy: NDArray[np.float64]) -> tuple[NDArray[np.uint16], NDArray[np.float64]]:
        """Return plane id (0: beside the building) and roof elevation (NaN there) at positions (n, 2)."""
        plane_id = np.zeros(len(xy), dtype=np.uint16)
        elevation = np.full(len(xy), np.nan)
        for number, face in enumerate(self.faces, start=1):
            rows = np.flatnonzero(shapely.intersects_xy(face.polygon, xy[:, 0], xy[:, 1]) & (plane_id == 0))
            plane_id[rows] = number
            elevation[rows] = face.elevation(xy[rows])
        return plane_id, elevation

    def placed(self, x: float, y: float, rotation_deg: float = 0.0, elevation: float = 0.0) -> Building:
        """Return the building turned counter-clockwise about the origin, then moved by (x, y, elevation)."""
        angle = np.deg2rad(rotation_deg)
        exterior, *holes = (_turned(ring, angle) + np.array([x, y]) for ring in self.outline.rings)
        return replace(
            self,
            faces=tuple(face.moved(x, y, angle, elevation) for face in self.faces),
            outline=Outline(exterior, tuple(holes)),
            ground_elevation=self.ground_elevation + elevation,
        )


def building_of(roof_type: str, faces: tuple[RoofFace, ...]) -> Building:
    """Return the building with these faces; their union is its outline."""
    union = shapely.union_all([face.polygon for face in faces], grid_size=GRID)
    exterior, *holes = (_corners(ring) for ring in Outline.of(union).rings)
    return Building(roof_type, faces, Outline(exterior, tuple(holes)))


def face_over(polygon: shapely.Polygon, plane: tuple[float, float, float]) -> RoofFace:
    """Return the roof face with this plane over a polygon."""
    return RoofFace(tuple(_corners(ring) for ring in Outline.of(polygon).rings), plane)


def _corners(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """Keep the vertices that stick out from their neighbours' connection by more than the grid."""
    before, after = np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0)
    chord, arm = after - before, ring - before
    offset = np.abs(chord[:, 0] * arm[:, 1] - chord[:, 1] * arm[:, 0]) / np.hypot(*chord.T)
    return ring[offset > 5 * GRID]


def _turned(ring: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    cos, sin = np.cos(angle), np.sin(angle)
    return ring @ np.array([[cos, sin], [-sin, cos]])


#: A vertex nearer than this to an edge lies on it [m].
ON_EDGE = 10 * GRID
#: Two elevations at a vertex that differ by less are the same [m].
SAME_ELEVATION = 1e-6


@dataclass(frozen=True)
class Wall:
    """A vertical piece of wall over the edge from `start` to `end`; outside is to the right of it."""

    start: tuple[float, float]  #: feet of the two verticals [m]
    end: tuple[float, float]
    bottom: tuple[float, float]  #: elevations at the start and at the end [m]
    top: tuple[float, float]
    outer: bool  #: whether it stands on the ground; else on a lower roof


@dataclass(frozen=True)
class Shell:
    """Surfaces of a solid: neighbours share their vertices, seen from outside they are counter-clockwise."""

    #: Each surface is a tuple of rings (outer ring, then holes) of shape (n, 3) [m].
    roofs: tuple[tuple[NDArray[np.float64], ...], ...]
    walls: tuple[tuple[NDArray[np.float64], ...], ...]
    floor: tuple[NDArray[np.float64], ...]  #: at the foot of the walls

    @property
    def surfaces(self) -> tuple[tuple[NDArray[np.float64], ...], ...]:
        """Roofs, then walls, then the floor."""
        return (*self.roofs, *self.walls, self.floor)


def shell_of(building: Building) -> Shell:
    """Return the building's solid, without vertices that only one of two neighbours has."""
    noded, walls = _noded_rings(building), walls_of(building)
    levels = _levels(walls)
    roofs = tuple(
        tuple(np.column_stack([ring, face.elevation(ring)]) for ring in rings)
        for face, rings in zip(building.faces, noded, strict=True)
    )
    return Shell(roofs, tuple((_wall_ring(wall, levels),) for wall in walls), _floor(building, noded))


def _noded_rings(building: Building) -> list[list[NDArray[np.float64]]]:
    """Each face's rings with the vertices of other faces that lie on their edges."""
    vertices = np.unique(np.concatenate([ring for face in building.faces for ring in face.rings]), axis=0)
    return [[_noded(ring, vertices) for ring in face.rings] for face in building.faces]


def _noded(ring: NDArray[np.float64], vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    pieces = []
    for start, end in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        edge = end - start
        length = np.hypot(*edge)
        along = (vertices - start) @ edge / length
        offset = np.abs((vertices - start) @ (-edge[1], edge[0])) / length
        inside = (offset < ON_EDGE) & (along > ON_EDGE) & (along < length - ON_EDGE)
        pieces += [start[None], vertices[inside][np.argsort(along[inside])]]
    return np.concatenate(pieces)


def walls_of(building: Building) -> list[Wall]:
    """Return the walls under all edges at which the roof ends or steps."""
    edges = {}
    for face, rings in zip(building.faces, _noded_rings(building), strict=True):
        for ring in rings:
            for start, end in zip(ring, np.roll(ring, -1, axis=0), strict=True):
                z = face.elevation(np.array([start, end]))
                edges[tuple(start), tuple(end)] = float(z[0]), float(z[1])
    ground = building.ground_elevation, building.ground_elevation
    walls = []
    for (start, end), top in edges.items():
        other = edges.get((end, start))
        bottom = ground if other is None else other[::-1]
        if max(top[0] - bottom[0], top[1] - bottom[1]) > SAME_ELEVATION:
            walls.append(Wall(start, end, bottom, top, other is None))
    return walls


def _levels(walls: list[Wall]) -> dict[tuple[float, float], list[float]]:
    """All elevations at which a wall begins or ends, per vertical."""
    levels: dict[tuple[float, float], list[float]] = {}
    for wall in walls:
        for end, foot in enumerate((wall.start, wall.end)):
            known = levels.setdefault(foot, [])
            for z in (wall.bottom[end], wall.top[end]):
                if all(abs(z - other) > SAME_ELEVATION for other in known):
                    known.append(z)
    return levels


def _wall_ring(wall: Wall, levels: dict[tuple[float, float], list[float]]) -> NDArray[np.float64]:
    """Up the vertical at the end, down the one at the start, with every level between."""

    def upright(end: int, foot: tuple[float, float]) -> list[tuple[float, float, float]]:
        low, high = wall.bottom[end] - SAME_ELEVATION, wall.top[end] + SAME_ELEVATION
        return [(*foot, z) for z in sorted(levels[foot]) if low < z < high]

    return np.array(upright(1, wall.end) + upright(0, wall.start)[::-1])


def _floor(building: Building, noded: list[list[NDArray[np.float64]]]) -> tuple[NDArray[np.float64], ...]:
    """The outline with the vertices of all faces, at the foot of the walls, seen from below."""
    vertices = np.unique(np.concatenate([ring for rings in noded for ring in rings]), axis=0)
    rings = []
    for ring in building.outline.rings:
        # each vertex is one of the faces', but for rounding
        distance = np.linalg.norm(ring[:, None] - vertices[None], axis=2)
        rings.append(_noded(vertices[np.argmin(distance, axis=1)], vertices)[::-1])
    return tuple(np.column_stack([ring, np.full(len(ring), building.ground_elevation)]) for ring in rings)
