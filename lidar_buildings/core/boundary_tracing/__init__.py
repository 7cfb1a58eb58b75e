"""
Boundary tracing: the rings round a building's points.

"""

from lidar_buildings.core.boundary_tracing.tracing import (
    BoundaryTracingConfig,
    TracedBoundary,
    trace_boundary,
)

__all__ = ["BoundaryTracingConfig", "TracedBoundary", "trace_boundary"]
