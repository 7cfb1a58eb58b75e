"""The verb: planes of a building in, adjusted planes and the lines between them out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.model.outline import Outline, corner_moves, ring_walls, walls_before
from lidar_buildings.core.neighbours.point_spacing import quantised_spacing
from lidar_buildings.core.solids.output_grid import on_grid
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
from lidar_buildings.core.surfaces.plane_adjustment import adjust
from lidar_buildings.core.surfaces.roof_planes import without_gaps

#: What edges of roofs are straighter than, however densely points lie [m].
_LEAST_DETAIL = 0.3
#: Keeps a division by variances of 0 finite [m²].
_LEAST_VARIANCE = 1e-12


def find_topology(
    points: FloatArray,
    plane_id: ArrayLike,
    outline: Outline,
    *,
    point_spacing: float | None = None,
    wall_variances: FloatArray | None = None,
) -> RoofTopology:
    """
    Adjust a roof's planes, and find the ridges, hips, valleys and step edges between them.

    Planes come numbered from 1, 0 = none, and are numbered anew without gaps. The point spacing is
    measured if not given [m]. Walls of the outline, its edges, move as far as planes and their variances
    across, shape (n_walls,) [m²], let them; without these they stay.
    """
    numbers = without_gaps(np.asarray(plane_id, dtype=np.uint16))
    spacing = point_spacing or quantised_spacing(points)
    adjustment = adjust(points, numbers)
    # Pieces of one level surface are seen from above as the first of them, walls not at all.
    region = np.append(0, np.where(adjustment.free.roof, adjustment.first + 1, 0)).astype(np.uint16)
    seen = region[numbers]
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
    variances = np.zeros(len(walls)) if wall_variances is None else wall_variances
    adjustment = replace(adjustment, walls=np.column_stack([np.zeros(len(variances)), variances]))
    adjustment = adjustment.under(find_conditions(adjustment, pieces, about, spacing))
    outline = _moved(outline, adjustment.walls[:, 0])
    walls = ring_walls(outline.rings)
    about = walls - centre[:2]
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
    found = tuple(intersections), tuple(steps)
    left = np.where(variances > 0.0, adjustment.walls[:, 1] / np.maximum(variances, _LEAST_VARIANCE), 1.0)
    both = adjustment.held, adjustment.refused
    return RoofTopology(adjustment.planes, *found, kind, *both, outline, left)


def _moved(outline: Outline, inwards: FloatArray) -> Outline:
    """Return an outline whose walls have moved [m], on the output grid; where none has, the same."""
    if not inwards.any():
        return outline
    walls = ring_walls(outline.rings)
    own = np.stack([inwards[walls_before(walls)], inwards], axis=1)
    corners = on_grid(walls[:, 0] + np.einsum("nwx,nw->nx", corner_moves(walls), own))
    exterior, *holes = np.split(corners, np.cumsum(list(map(len, outline.rings)))[:-1])
    return Outline(exterior, tuple(holes))
