"""
How the planes of a roof border on one another: ridges, hips, valleys, step edges, and the kind of roof.

Lengths are in point spacings and were chosen on the virtual roofs of `bench.pages.roof_topology` unless said.
"""

from lidar_buildings.core.stages.roof_topology.result import (
    HIP,
    RIDGE,
    STEP,
    VALLEY,
    IntersectionSegment,
    RoofTopology,
    StepEdge,
)
from lidar_buildings.core.stages.roof_topology.topology import find_topology

__all__ = [
    "HIP",
    "RIDGE",
    "STEP",
    "VALLEY",
    "IntersectionSegment",
    "RoofTopology",
    "StepEdge",
    "find_topology",
]
