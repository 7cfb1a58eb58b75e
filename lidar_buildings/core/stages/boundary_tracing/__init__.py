"""Boundary tracing: the rings round a building's points."""

from lidar_buildings.core.stages.boundary_tracing.config import AS_PUBLISHED, BoundaryTracingConfig
from lidar_buildings.core.stages.boundary_tracing.tracing import TracedBoundary, rows_to_trace, trace_boundary

__all__ = ["AS_PUBLISHED", "BoundaryTracingConfig", "TracedBoundary", "rows_to_trace", "trace_boundary"]
