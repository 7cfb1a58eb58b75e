"""A building's outline: one outer ring and its courtyards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.status import BuildingStatus


@dataclass(frozen=True, eq=False)
class Outline:
    """An outer ring and its holes, open (no repeated vertex)."""

    exterior: NDArray[np.float64]  #: counter-clockwise, map frame [m], shape (n_vertices, 2)
    holes: tuple[NDArray[np.float64], ...] = ()  #: clockwise, map frame [m], shape (n_vertices, 2)

    @property
    def rings(self) -> tuple[NDArray[np.float64], ...]:
        """The outer ring first, then the holes."""
        return (self.exterior, *self.holes)

    @property
    def area(self) -> float:
        """Area inside the outer ring less that of the holes [m²]."""
        return float(sum(signed_area(ring) for ring in self.rings))

    @property
    def polygon(self) -> shapely.Polygon:
        """The outline as a polygon; empty if the outer ring has fewer than three vertices."""
        if len(self.exterior) < 3:
            return shapely.Polygon()
        return shapely.Polygon(self.exterior, [hole for hole in self.holes if len(hole) >= 3])

    @classmethod
    def of(cls, polygon: shapely.Polygon) -> Outline:
        """Return the rings of a polygon, the outer one counter-clockwise and its holes clockwise."""
        exterior, *holes = map(shapely.get_coordinates, (polygon.exterior, *polygon.interiors))
        return cls(exterior[:-1], tuple(hole[:-1] for hole in holes)).oriented()

    def oriented(self) -> Outline:
        """Return the same outline with the outer ring counter-clockwise and the holes clockwise."""
        exterior = self.exterior if signed_area(self.exterior) >= 0 else self.exterior[::-1]
        return Outline(exterior, tuple(h if signed_area(h) <= 0 else h[::-1] for h in self.holes))

    def as_carried(self) -> Outline:
        """Return the outline as a message carries it: coordinates rounded to float32."""
        exterior, *holes = (ring.astype(np.float32).astype(np.float64) for ring in self.rings)
        return Outline(exterior, tuple(holes))

    def same_as(self, other: Outline) -> bool:
        """Whether both have the same rings, vertex for vertex."""
        return len(self.rings) == len(other.rings) and all(
            np.array_equal(mine, theirs) for mine, theirs in zip(self.rings, other.rings, strict=True)
        )


@dataclass(frozen=True)
class OutlineQuality:
    """How well a regularised outline fits the traced one."""

    sigma: float  #: standard deviation of the points on walls about the outline [m]
    max_offset: float  #: largest distance of a point on a wall from the outline [m]
    status: BuildingStatus  #: OK, TRACED_OUTLINE, or FAILED with NaN for the other two
    reason: str  #: why it is the traced outline, or what else was out of the ordinary; else empty
    bias: float = 0.0  #: by how much the roof's edge is thought to lie outside of it [m]


@dataclass(frozen=True, eq=False)
class BuildingOutline:
    """The outline of one building, as it travels between stages."""

    building_id: int  #: see `lidar_buildings.core.model.ids`
    outline: Outline  #: rings in the map frame [m]
    #: Of the ground at the building, map frame [m]; None where it is left to the building's points.
    ground_elevation: float | None = None
    quality: OutlineQuality | None = None  #: from regularisation on


def signed_area(ring: NDArray[np.float64]) -> float:
    """Area of an open ring, shape (n, 2): positive if counter-clockwise, 0 for fewer than 3 vertices."""
    if len(ring) < 3:
        return 0.0
    # Seen from the first corner, what closes the ring adds nothing.
    x, y = (ring - ring[0]).T
    return 0.5 * float(x[:-1].dot(y[1:]) - y[:-1].dot(x[1:]))


def ring_walls(rings: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return both ends of every edge of open rings, shape (n_vertices, 2, 2)."""
    walls = np.empty((sum(map(len, rings)), 2, 2))
    first = 0
    for ring in rings:
        own = walls[first : first + len(ring)]
        own[:, 0], own[:-1, 1], own[-1:, 1] = ring, ring[1:], ring[:1]
        first += len(ring)
    return walls


#: Walls that turn by less than this have no common point worth taking: sine of 15°.
LEAST_TURN = 0.2588
#: Keeps divisions by the lengths of walls finite [m].
_SHORTEST = 1e-3


def across_walls(walls: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return unit vectors to the left of walls, into the building, shape (n_walls, 2)."""
    along = walls[:, 1] - walls[:, 0]
    return np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(np.hypot(*along.T), _SHORTEST)[:, None]


def walls_before(walls: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the row of the wall that ends where each starts; rings come one after the other."""
    before = np.roll(np.arange(len(walls)), 1)
    first = np.flatnonzero((walls[:, 0] != walls[before, 1]).any(axis=1))
    before[first] = np.roll(before[first], -1)
    return before


def corner_moves(walls: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return where the start of each wall goes as the wall before it, and it itself, move inwards, (n, 2, 2).

    It stays where both meet; at a corner that hardly turns it goes half the way of each.
    """
    after = across_walls(walls)
    both = np.stack([after[walls_before(walls)], after], axis=1)
    sine = both[:, 0, 0] * both[:, 1, 1] - both[:, 0, 1] * both[:, 1, 0]
    turns, moves = np.abs(sine) > LEAST_TURN, 0.5 * both
    other = both[turns, ::-1]  # along the other wall
    moves[turns] = np.stack([other[:, :, 1], -other[:, :, 0]], axis=2) * np.array([[1.0], [-1.0]])
    moves[turns] /= sine[turns, None, None]
    return moves
