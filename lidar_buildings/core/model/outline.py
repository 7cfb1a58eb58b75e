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
