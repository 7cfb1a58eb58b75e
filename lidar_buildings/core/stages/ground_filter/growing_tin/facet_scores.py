"""How well a candidate fits a facet of the terrain, or its mirror image the facet beyond (Axelsson 2000)."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.stages.ground_filter.growing_tin.frame import at_frame
from lidar_buildings.core.surfaces.tin import corners_of, place_of, plane_elevation, plane_slope, walk

# Chosen with `bench.ground.isprs` and `bench.ground.scenes`; mirroring is Axelsson's (2000).
#: A facet is left as it is by points this close to it: they add nothing to its shape [m].
FLAT_DISTANCE = 0.05
#: Rise over run from which a facet may span a step of the terrain, so that points are tried mirrored as well.
MIRROR_SLOPE = 0.1


@kernel
def candidate_score(p, triangle, vertices, n_real, n_start, triangles, neighbours, limits):  # type: ignore[no-untyped-def]
    """
    Return how well a candidate, row p of `vertices`, fits the terrain, the less the better.

    Infinity where it may not join, neither as it is nor mirrored.
    """
    a, b, c = corners_of(triangle, vertices, triangles)
    point = place_of(p, vertices)
    score = _facet_score(point, a, b, c, limits)
    if score == np.inf:
        score = _mirrored_score(p, triangle, vertices, n_real, n_start, triangles, neighbours, limits)
    return score


@kernel
def _facet_score(point, a, b, c, limits):  # type: ignore[no-untyped-def]
    """
    Return how well a point fits a facet; infinity where it may not join.

    Below the facet the distance to it, negative; above it the largest angle at a corner.
    """
    angle, gain, distance = limits
    slope = plane_slope(a, b, c)
    above = (point[2] - plane_elevation(point[0], point[1], a, b, c)) / math.sqrt(1.0 + slope * slope)
    if above < -FLAT_DISTANCE:
        return above
    if above < FLAT_DISTANCE or above > distance:
        return np.inf
    seen_at = _angle_at_corners(point, a, b, c, above)
    return seen_at if seen_at <= angle or seen_at <= angle + gain * math.atan(slope) else np.inf


@kernel
def _mirrored_score(p, triangle, vertices, n_real, n_start, triangles, neighbours, limits):  # type: ignore[no-untyped-def]
    """
    Return how well a candidate, mirrored at its facet's nearest corner, fits the terrain there.

    Level ground that ends in a step reaches its edge in this way; a roof does not, as its corners are ground.
    """
    angle, _, distance = limits
    if plane_slope(*corners_of(triangle, vertices, triangles)) < MIRROR_SLOPE:
        return np.inf
    x, y, z = place_of(p, vertices)
    corner = _nearest_corner(x, y, triangle, vertices, triangles)
    if n_real <= corner < n_start or abs(z - vertices[corner, 2]) > distance:
        return np.inf
    x, y = 2.0 * vertices[corner, 0] - x, 2.0 * vertices[corner, 1] - y
    there = walk(x, y, triangle, vertices, triangles, neighbours)
    if at_frame(there, triangles, n_real, n_start):
        return np.inf
    a, b, c = corners_of(there, vertices, triangles)
    off = abs(z - plane_elevation(x, y, a, b, c)) / math.hypot(1.0, plane_slope(a, b, c))
    if off > distance:
        return np.inf
    seen_at = _angle_at_corners((x, y, z), a, b, c, off)
    return seen_at if seen_at <= angle else np.inf


@kernel
def _angle_at_corners(point, a, b, c, off):  # type: ignore[no-untyped-def]
    """Return the largest angle between a facet and the lines from its corners to a point `off` it [rad]."""
    nearest = math.sqrt(min(_squared(point, a), _squared(point, b), _squared(point, c)))
    return math.asin(min(1.0, off / nearest)) if nearest > 0.0 else 0.0


@kernel
def _nearest_corner(x, y, triangle, vertices, triangles):  # type: ignore[no-untyped-def]
    nearest, least = triangles[triangle, 0], np.inf
    for k in range(3):
        v = triangles[triangle, k]
        away = (vertices[v, 0] - x) ** 2 + (vertices[v, 1] - y) ** 2
        if away < least:
            nearest, least = v, away
    return nearest


@kernel
def _squared(p, q):  # type: ignore[no-untyped-def]
    return (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2
