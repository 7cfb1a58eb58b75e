"""What a regularised outline consists of."""

from __future__ import annotations

from dataclasses import dataclass

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.model.status import BuildingStatus


@dataclass(frozen=True)
class OutlineWall:
    """One wall of an outline."""

    ring: int  #: 0 for the outer ring, then the courtyards
    kind: str  #: ``"line"``, ``"arc"``, or ``"step"`` between two parallel walls
    #: Its ends, in the ring's order [m].
    start: tuple[float, float]
    end: tuple[float, float]
    centre: tuple[float, float] | None  #: of an arc [m]
    #: Of an arc, positive where the ring goes round its centre counter-clockwise; 0 for the others [m].
    radius: float


@dataclass(frozen=True, eq=False)
class RegularisedOutline:
    """An outline of straight walls and arcs, and how well it fits."""

    outline: Outline  #: simple and valid; the traced outline where it could not be regularised
    sigma: float  #: standard deviation of the points on walls about the lines and arcs through them [m]
    max_offset: float  #: largest distance of a point on a wall from the outline [m]
    #: Directions of the long walls within 0 to π/2, each standing for itself and its perpendicular, the most
    #: frequent first [rad].
    directions: tuple[float, ...]
    status: BuildingStatus  #: OK or TRACED_OUTLINE
    reason: str  #: why it is the traced outline, or what else was out of the ordinary; else empty
    walls: tuple[OutlineWall, ...] = ()  #: ring by ring, in order, without those of courtyards left as traced
