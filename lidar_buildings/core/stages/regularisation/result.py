"""What a regularised outline consists of."""

from __future__ import annotations

from dataclasses import dataclass

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.model.status import BuildingStatus


@dataclass(frozen=True)
class OutlineWall:
    """
    One wall of an outline.

    Attributes
    ----------
    ring : int
        0 for the outer ring, then the courtyards.
    kind : str
        ``"line"``, ``"arc"``, or ``"step"`` between two parallel walls.
    start, end : tuple of two float
        Its ends, in the ring's order [m].
    centre : tuple of two float or None
        Of an arc [m].
    radius : float
        Of an arc, positive where the ring goes round its centre counter-clockwise; 0 for the others [m].
    """

    ring: int
    kind: str
    start: tuple[float, float]
    end: tuple[float, float]
    centre: tuple[float, float] | None
    radius: float


@dataclass(frozen=True, eq=False)
class RegularisedOutline:
    """
    An outline of straight walls and arcs, and how well it fits.

    Attributes
    ----------
    outline : Outline
        Simple and valid; the traced outline where it could not be regularised.
    sigma : float
        Standard deviation of the points on walls about the lines and arcs through them [m].
    max_offset : float
        Largest distance of a point on a wall from the outline [m].
    directions : tuple of float
        Directions of the long walls within 0 to π/2, each standing for itself and its perpendicular, the
        most frequent first [rad].
    status : BuildingStatus
        OK or TRACED_OUTLINE.
    reason : str
        Why it is the traced outline, or what else was out of the ordinary; else empty.
    walls : tuple of OutlineWall
        Ring by ring, in order, without those of courtyards left as traced.
    """

    outline: Outline
    sigma: float
    max_offset: float
    directions: tuple[float, ...]
    status: BuildingStatus
    reason: str
    walls: tuple[OutlineWall, ...] = ()
