"""What is found of a roof's topology."""

from __future__ import annotations

from dataclasses import dataclass

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.surfaces.roof_planes import RoofPlane

#: Kinds of lines in which two planes meet.
RIDGE, HIP, VALLEY = "ridge", "hip", "valley"
#: Kind of border where two planes do not meet.
STEP = "step"


@dataclass(frozen=True, eq=False)
class IntersectionSegment:
    """
    A piece of the line in which two planes meet.

    Attributes
    ----------
    first, second : int
        Numbers of the planes, ``first < second``.
    kind : str
        ``ridge`` (convex, nearly level), ``hip`` (convex, inclined) or ``valley`` (concave).
    segment : ndarray of shape (2, 3)
        Its ends, exactly on both planes [m].
    length : float
        Length in plan of the border between the two planes' regions that lies along it [m].
    """

    first: int
    second: int
    kind: str
    segment: FloatArray
    length: float


@dataclass(frozen=True, eq=False)
class StepEdge:
    """
    A straight piece of the border between two planes that do not meet there.

    Attributes
    ----------
    upper, lower : int
        Numbers of the planes; `lower` is 0 where what lies below is in no plane.
    segment : ndarray of shape (2, 2)
        Its ends in plan [m].
    height : tuple of two float
        Height of the step at either end [m]; NaN where the lower side is unknown.
    length : float
        Length of the border between the two regions that lies along it [m].
    """

    upper: int
    lower: int
    segment: FloatArray
    height: tuple[float, float]
    length: float


@dataclass(frozen=True, eq=False)
class RoofTopology:
    """
    The planes of a roof and the lines along which they border on one another.

    Attributes
    ----------
    planes : tuple of RoofPlane
        Adjusted; plane number k is ``planes[k - 1]``.
    intersections : tuple of IntersectionSegment
        Ridges, hips and valleys.
    steps : tuple of StepEdge
        Borders where planes do not meet.
    roof_type : str
        See `lidar_buildings.core.stages.roof_topology.roof_type`.
    """

    planes: tuple[RoofPlane, ...]
    intersections: tuple[IntersectionSegment, ...]
    steps: tuple[StepEdge, ...]
    roof_type: str
