"""What is found of a roof's topology."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.surfaces.plane_adjustment import Condition
from lidar_buildings.core.surfaces.roof_planes import RoofPlane

#: Kinds of lines in which two planes meet.
RIDGE, HIP, VALLEY = "ridge", "hip", "valley"
#: Kind of border where two planes do not meet.
STEP = "step"


@dataclass(frozen=True, eq=False)
class IntersectionSegment:
    """A piece of the line in which two planes meet."""

    #: Numbers of the planes, ``first < second``.
    first: int
    second: int
    kind: str  #: ``ridge`` (convex, nearly level), ``hip`` (convex, inclined) or ``valley`` (concave)
    segment: FloatArray  #: its ends, exactly on both planes [m], shape (2, 3)
    length: float  #: length in plan of the border between the two planes' regions that lies along it [m]


@dataclass(frozen=True, eq=False)
class StepEdge:
    """A straight piece of the border between two planes that do not meet there."""

    #: Numbers of the planes; `lower` is 0 where what lies below is in no plane.
    upper: int
    lower: int
    segment: FloatArray  #: its ends in plan [m], shape (2, 2)
    height: tuple[float, float]  #: height of the step at either end [m]; NaN where the lower side is unknown
    length: float  #: length of the border between the two regions that lies along it [m]


@dataclass(frozen=True, eq=False)
class RoofTopology:
    """The planes of a roof and the lines along which they border on one another."""

    planes: tuple[RoofPlane, ...]  #: adjusted; plane number k is ``planes[k - 1]``
    intersections: tuple[IntersectionSegment, ...]  #: ridges, hips and valleys
    steps: tuple[StepEdge, ...]  #: borders where planes do not meet
    roof_type: str  #: see `lidar_buildings.core.stages.roof_topology.roof_type`
    held: tuple[Condition, ...] = ()  #: what the planes have in common
    refused: tuple[Condition, ...] = ()  #: what they might have, but that the points refuse
    #: Its walls where planes and points together say; None if nothing was adjusted.
    outline: Outline | None = None
    #: Share of the variance of each wall across that is left, shape (n_walls,); None likewise.
    wall_shares: FloatArray | None = None

    @property
    def told_conditions(self) -> str:
        """How many conditions of each kind hold, and how many the points refuse; empty if there is none."""
        held, refused = (
            ", ".join(f"{kind} {n}" for kind, n in sorted(Counter(one.kind for one in group).items()))
            for group in (self.held, self.refused)
        )
        return "; ".join(part for part in (held, refused and f"refused: {refused}") if part)
