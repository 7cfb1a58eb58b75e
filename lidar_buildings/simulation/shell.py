"""The closed shell of a building: roof, walls under the roof's edges and steps, and floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.simulation.building import GRID, Building

#: A vertex nearer than this to an edge lies on it [m].
ON_EDGE = 10 * GRID
#: Two elevations at a vertex that differ by less are the same [m].
SAME_ELEVATION = 1e-6


@dataclass(frozen=True)
class Wall:
    """A vertical piece of wall over the edge from `start` to `end`; outside is to the right of it."""

    #: Feet of the two verticals [m].
    start: tuple[float, float]
    end: tuple[float, float]
    #: Elevations at the start and at the end [m].
    bottom: tuple[float, float]
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


def walls_of(building: Building) -> tuple[Wall, ...]:
    """Return the walls under all edges at which the roof ends or steps."""
    return tuple(_walls(building, _noded_rings(building)))


def shell_of(building: Building) -> Shell:
    """Return the building's solid, without vertices that only one of two neighbours has."""
    noded = _noded_rings(building)
    walls = _walls(building, noded)
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
    """Insert the vertices that lie inside the ring's edges."""
    pieces = []
    for start, end in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        edge = end - start
        length = np.hypot(*edge)
        along = (vertices - start) @ edge / length
        offset = np.abs((vertices - start) @ (-edge[1], edge[0])) / length
        inside = (offset < ON_EDGE) & (along > ON_EDGE) & (along < length - ON_EDGE)
        pieces += [start[None], vertices[inside][np.argsort(along[inside])]]
    return np.concatenate(pieces)


def _walls(building: Building, noded: list[list[NDArray[np.float64]]]) -> list[Wall]:
    """Compare the roof's elevation on both sides of every edge."""
    edges = {}
    for face, rings in zip(building.faces, noded, strict=True):
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
        for foot, *elevations in (
            (wall.start, wall.bottom[0], wall.top[0]),
            (wall.end, wall.bottom[1], wall.top[1]),
        ):
            for z in elevations:
                known = levels.setdefault(foot, [])
                if all(abs(z - other) > SAME_ELEVATION for other in known):
                    known.append(z)
    return levels


def _wall_ring(wall: Wall, levels: dict[tuple[float, float], list[float]]) -> NDArray[np.float64]:
    """Up the vertical at the end, down the one at the start, with every level between."""
    rising = _between(levels[wall.end], wall.bottom[1], wall.top[1])
    falling = _between(levels[wall.start], wall.bottom[0], wall.top[0])[::-1]
    return np.array([(*wall.end, z) for z in rising] + [(*wall.start, z) for z in falling])


def _between(levels: list[float], bottom: float, top: float) -> list[float]:
    return sorted(z for z in levels if bottom - SAME_ELEVATION < z < top + SAME_ELEVATION)


def _floor(building: Building, noded: list[list[NDArray[np.float64]]]) -> tuple[NDArray[np.float64], ...]:
    """The outline with the vertices of all faces, at the foot of the walls, seen from below."""
    vertices = np.unique(np.concatenate([ring for rings in noded for ring in rings]), axis=0)
    rings = [_noded(_snapped(ring, vertices), vertices)[::-1] for ring in building.outline.rings]
    return tuple(np.column_stack([ring, np.full(len(ring), building.ground_elevation)]) for ring in rings)


def _snapped(ring: NDArray[np.float64], vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Replace each vertex by the nearest of the faces', the same but for rounding."""
    distance = np.linalg.norm(ring[:, None] - vertices[None], axis=2)
    return vertices[np.argmin(distance, axis=1)]
