"""The verb: planes of a building in, adjusted planes and the lines between them out."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.neighbours.point_spacing import quantised_spacing
from lidar_buildings.core.stages.roof_topology.conditions import find_conditions
from lidar_buildings.core.stages.roof_topology.intersections import find_pieces, finished, piece_ends
from lidar_buildings.core.stages.roof_topology.regions import find_borders
from lidar_buildings.core.stages.roof_topology.result import RoofTopology
from lidar_buildings.core.stages.roof_topology.roof_type import roof_type
from lidar_buildings.core.stages.roof_topology.step_edges import (
    extended,
    find_step_lines,
    snapped,
    step_edges,
    step_segments,
)
from lidar_buildings.core.surfaces.plane_adjustment import Adjustment, adjust
from lidar_buildings.core.surfaces.roof_planes import without_gaps

#: What edges of roofs are straighter than, however densely points lie [m].
_LEAST_DETAIL = 0.3
#: Decimals to which the coefficients of planes that are one agree.
_SAME_DECIMALS = 9


def find_topology(
    points: FloatArray,
    plane_id: ArrayLike,
    outline: Outline,
    *,
    point_spacing: float | None = None,
    corner_sigma: float = 0.0,
) -> RoofTopology:
    """
    Adjust a roof's planes, and find the ridges, hips, valleys and step edges between them.

    Planes come numbered from 1, 0 = none, and are numbered anew without gaps. The point spacing is
    measured if not given; `corner_sigma` is how sure the outline's corners are along x and y [m].
    """
    numbers = without_gaps(np.asarray(plane_id, dtype=np.uint16))
    spacing = point_spacing or quantised_spacing(points)
    adjustment = adjust(points, numbers)
    seen = _regions_of(adjustment)[numbers]
    if np.count_nonzero(seen) < 3:
        return RoofTopology(adjustment.planes, (), (), "unknown", adjustment.held)
    if np.count_nonzero(np.bincount(seen)[1:]) == 1:
        # One plane borders on none.
        kind = roof_type(points, seen, adjustment.coefficients, (), (), spacing)
        return RoofTopology(adjustment.planes, (), (), kind, adjustment.held)
    centre, walls = adjustment.centre, ring_walls(outline.rings)
    about = walls - centre[:2]
    borders = find_borders(points, seen, outline, centre, spacing)
    pieces = find_pieces(borders, points, adjustment.coefficients, centre, spacing)
    adjustment = adjustment.under(find_conditions(adjustment, pieces, about, spacing, corner_sigma))
    pieces = find_pieces(borders, points, adjustment.coefficients, centre, spacing)
    gradients = adjustment.coefficients
    area = adjustment.free.counts * spacing**2
    ends = piece_ends(pieces, gradients)
    scale = max(spacing, _LEAST_DETAIL)
    lines = find_step_lines(borders, pieces.on_line, points, gradients, area, walls, centre, scale)
    lines = extended(snapped(lines, about, scale), ends, about, scale)
    segments = step_segments(lines)
    intersections = finished(pieces, gradients, centre, about, segments, adjustment.held, spacing)
    steps = step_edges(lines, segments, gradients, centre)
    kind = roof_type(points, seen, gradients, intersections, steps, spacing)
    return RoofTopology(
        adjustment.planes, tuple(intersections), tuple(steps), kind, adjustment.held, adjustment.refused
    )


def _regions_of(adjustment: Adjustment) -> NDArray[np.uint16]:
    """Return the number under which each plane is seen from above; planes that are one have the first's."""
    region = np.zeros(len(adjustment.coefficients) + 1, dtype=np.uint16)
    roofs = np.flatnonzero(adjustment.free.roof)
    rounded = np.round(adjustment.coefficients[roofs], _SAME_DECIMALS)
    first: dict[tuple[float, ...], int] = {}
    for number, plane in zip((roofs + 1).tolist(), rounded.tolist(), strict=True):
        region[number] = first.setdefault(tuple(plane), number)
    return region
