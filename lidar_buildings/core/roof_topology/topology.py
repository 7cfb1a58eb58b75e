"""
The verb: planes of a building in, adjusted planes and the lines between them out.

"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.outline import Outline
from lidar_buildings.core.point_array import checked_column, checked_points
from lidar_buildings.core.point_spacing import given_or_measured
from lidar_buildings.core.roof_planes import RoofPlane, adjust_planes
from lidar_buildings.core.roof_topology.borders import Borders, find_borders
from lidar_buildings.core.roof_topology.meetings import Pieces, find_pieces, intersection_line
from lidar_buildings.core.roof_topology.region_raster import region_raster
from lidar_buildings.core.roof_topology.result import (
    HIP,
    RIDGE,
    STEP,
    VALLEY,
    Adjacency,
    IntersectionSegment,
    RoofTopology,
    StepEdge,
)
from lidar_buildings.core.roof_topology.steps import find_steps
from lidar_buildings.core.roof_type import roof_type

#: Steeper planes are walls: they have no region seen from above [deg].
_STEEPEST_DEG = 80.0
#: A convex line is a ridge if it is less steep than this share of the steeper plane.
_RIDGE_SHARE = 0.3


def find_topology(
    points: ArrayLike,
    plane_id: ArrayLike,
    outline: Outline | None = None,
    *,
    point_spacing: float | None = None,
) -> RoofTopology:
    """
    Adjust a roof's planes, and find the ridges, hips, valleys and step edges between them.

    Parameters
    ----------
    points : array_like of shape (n_points, 3)
        The building's roof points, in any order [m].
    plane_id : array_like of shape (n_points,)
        Number of each point's plane, 0 = none.
    outline : Outline, optional
        Without it the roof is where points are.
    point_spacing : float, optional
        1/√density [m]; measured if not given.

    Returns
    -------
    RoofTopology

    Raises
    ------
    ValueError
        If an array has another shape, a value is not finite, or the spacing no positive length.

    """
    points = checked_points(points)
    numbers = checked_column("plane_id", plane_id, len(points), np.uint16)
    spacing = given_or_measured(points, point_spacing)
    planes = adjust_planes(points, numbers, outline=outline, point_spacing=spacing)
    kind = roof_type(points, numbers)
    centre, gradients = _gradients(planes)
    roofs = np.concatenate([[False], np.hypot(gradients[:, 0], gradients[:, 1]) < _steepest()])
    seen = np.where(roofs[numbers], numbers, 0).astype(np.uint16)
    if np.count_nonzero(seen) < 3:
        return RoofTopology(planes, (), (), (), kind)
    rings = tuple(ring for ring in outline.rings if len(ring) >= 3) if outline is not None else ()
    raster = region_raster(points, seen, rings, spacing)
    borders = find_borders(raster, centre)
    pieces = find_pieces(borders, raster, gradients, centre, spacing)
    intersections = _segments(pieces, gradients, centre)
    n_points = np.array([plane.n_points for plane in planes], dtype=float)
    steps = find_steps(borders, pieces.on_line, gradients, n_points, rings, centre, spacing)
    return RoofTopology(
        planes, tuple(intersections), tuple(steps), _adjacency(borders, intersections, steps), kind
    )


def _steepest() -> float:
    """
    Slope of the steepest roofs [m/m].

    """
    return math.tan(math.radians(_STEEPEST_DEG))


def _gradients(planes: tuple[RoofPlane, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Return a centre, and a, b, c of each plane z = a x + b y + c about it; infinite slopes for walls.

    """
    if not planes:
        return np.zeros(3), np.zeros((0, 3))
    normals = np.array([plane.normal for plane in planes])
    centroids = np.array([plane.centroid for plane in planes])
    centre = 0.5 * (centroids.min(axis=0) + centroids.max(axis=0))
    upright = np.maximum(normals[:, 2], 1e-6)
    slopes = -normals[:, :2] / upright[:, None]
    offsets = centroids - centre
    heights = offsets[:, 2] - np.einsum("ij,ij->i", slopes, offsets[:, :2])
    return centre, np.column_stack([slopes, heights])


def _segments(
    pieces: Pieces, gradients: NDArray[np.float64], centre: NDArray[np.float64]
) -> list[IntersectionSegment]:
    """
    Return the pieces as segments in space.

    """
    segments = []
    for k in range(len(pieces.pair)):
        i, j = int(pieces.first[k]), int(pieces.second[k])
        p, q = gradients[i - 1], gradients[j - 1]
        fx, fy, ux, uy, _ = intersection_line(p, q)
        t = pieces.t[k]
        xy = np.array([fx, fy]) + t[:, None] * np.array([ux, uy])
        z = xy @ p[:2] + p[2]
        kind = _kind(pieces.convex[k], p[0] * ux + p[1] * uy, max(np.hypot(*p[:2]), np.hypot(*q[:2])))
        segment = np.column_stack([xy, z]) + centre
        segments.append(
            IntersectionSegment(i, j, kind, segment, float(pieces.length[k]), int(pieces.n_points[k]))
        )
    return segments


def _kind(convex: bool, rise: float, steepness: float) -> str:
    """
    Name the kind of line by its shape and its own slope.

    """
    if not convex:
        return VALLEY
    return RIDGE if abs(rise) < _RIDGE_SHARE * steepness else HIP


def _adjacency(
    borders: Borders, intersections: list[IntersectionSegment], steps: list[StepEdge]
) -> tuple[Adjacency, ...]:
    """
    Sum the borders of each pair by kind; the longest kind names the pair.

    """
    lengths: dict[tuple[int, int], dict[str, float]] = {}
    for line in intersections:
        kinds = lengths.setdefault((line.first, line.second), {})
        kinds[line.kind] = kinds.get(line.kind, 0.0) + line.length
    for step in steps:
        if step.lower:
            kinds = lengths.setdefault((min(step.upper, step.lower), max(step.upper, step.lower)), {})
            kinds[STEP] = kinds.get(STEP, 0.0) + step.length
    return tuple(
        Adjacency(i, j, max(kinds, key=lambda kind: kinds[kind]), sum(kinds.values()))
        for (i, j), kinds in sorted(lengths.items())
    )
