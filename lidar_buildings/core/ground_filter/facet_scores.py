"""
How well a candidate fits a facet of the terrain, or its mirror image the facet beyond (Axelsson 2000).

"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from lidar_buildings.core.tin import plane_elevation, plane_slope, walk

#: A facet is left as it is by points this close to it: they add nothing to its shape [m].
FLAT_DISTANCE = 0.05
#: Rise over run from which a facet may span a step of the terrain, so that points are tried mirrored as well.
MIRROR_SLOPE = 0.1


@njit(cache=True, nogil=True)
def facet_score(point, vertices, corners, limits):  # type: ignore[no-untyped-def]
    """
    Return how well a point fits a facet, the less the better; infinity where it may not join.

    Below the facet the distance to it, negative; above it the largest angle at a corner.

    """
    angle, gain, distance, squared_side = limits
    a, b, c = vertices[corners[0]], vertices[corners[1]], vertices[corners[2]]
    if _squared_longest_side(a, b, c) < squared_side:
        return np.inf
    slope = plane_slope(a, b, c)
    above = (point[2] - plane_elevation(point[0], point[1], a, b, c)) / math.hypot(1.0, slope)
    if above < -FLAT_DISTANCE:
        return above
    if above < FLAT_DISTANCE or above > distance:
        return np.inf
    seen_at = _angle_at_corners(point, a, b, c, above)
    return seen_at if seen_at <= angle + gain * math.atan(slope) else np.inf


@njit(cache=True, nogil=True)
def mirrored_score(p, triangle, vertices, n_real, n_start, triangles, neighbours, limits):  # type: ignore[no-untyped-def]
    """
    Return how well a candidate, mirrored at its facet's nearest corner, fits the terrain there.

    Level ground that ends in a step reaches its edge in this way; a roof does not, as its corners are ground.

    """
    angle, _, distance, squared_side = limits
    corners = triangles[triangle]
    a, b, c = vertices[corners[0]], vertices[corners[1]], vertices[corners[2]]
    if plane_slope(a, b, c) < MIRROR_SLOPE or _squared_longest_side(a, b, c) < squared_side:
        return np.inf
    corner = _nearest_corner(vertices, p, corners)
    if n_real <= corner < n_start or abs(vertices[p, 2] - vertices[corner, 2]) > distance:
        return np.inf
    mirrored = 2.0 * vertices[corner] - vertices[p]
    mirrored[2] = vertices[p, 2]
    there = triangles[walk(mirrored[0], mirrored[1], triangle, vertices, triangles, neighbours)]
    for v in there:
        if n_real <= v < n_start:
            return np.inf
    a, b, c = vertices[there[0]], vertices[there[1]], vertices[there[2]]
    offset = mirrored[2] - plane_elevation(mirrored[0], mirrored[1], a, b, c)
    off = abs(offset) / math.hypot(1.0, plane_slope(a, b, c))
    seen_at = _angle_at_corners(mirrored, a, b, c, off)
    return seen_at if off <= distance and seen_at <= angle else np.inf


@njit(cache=True, nogil=True)
def _angle_at_corners(point, a, b, c, off):  # type: ignore[no-untyped-def]
    """
    Return the largest angle between a facet and the lines from its corners to a point `off` it [rad].

    """
    nearest = math.sqrt(min(_squared(point, a), _squared(point, b), _squared(point, c)))
    return math.asin(min(1.0, off / nearest)) if nearest > 0.0 else 0.0


@njit(cache=True, nogil=True)
def _nearest_corner(vertices, p, corners):  # type: ignore[no-untyped-def]
    """
    Return the corner nearest to vertex p in plan.

    """
    nearest, least = corners[0], np.inf
    for v in corners:
        away = (vertices[v, 0] - vertices[p, 0]) ** 2 + (vertices[v, 1] - vertices[p, 1]) ** 2
        if away < least:
            nearest, least = v, away
    return nearest


@njit(cache=True, nogil=True)
def _squared_longest_side(a, b, c):  # type: ignore[no-untyped-def]
    """
    Return the square of a triangle's longest side in plan [m²].

    """
    ab = (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2
    bc = (c[0] - b[0]) ** 2 + (c[1] - b[1]) ** 2
    ca = (a[0] - c[0]) ** 2 + (a[1] - c[1]) ** 2
    return max(ab, bc, ca)


@njit(cache=True, nogil=True)
def _squared(p, q):  # type: ignore[no-untyped-def]
    """
    Return the squared distance of two points in space [m²].

    """
    return (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2
