"""The rings of the alpha shape, the second method."""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.stages.boundary_tracing.courtyards import CourtyardRules
from lidar_buildings.core.surfaces.alpha_shape import AlphaShape, alpha_shape

#: How the disc grows while the shape falls apart or leaves points out.
_GROWTH = 1.25
#: Attempts before the disc becomes a half-plane and the shape the convex hull.
_MAX_ATTEMPTS = 24


def alpha_outline(
    xy: NDArray[np.float64], radius: float, rules: CourtyardRules | None
) -> tuple[Outline, list[str]]:
    """
    Return the outline of the alpha shape with the smallest disc that leaves one piece with all points.

    Parameters
    ----------
    xy : ndarray of shape (n_points, 2)
        Distinct positions, not all on a line [m].
    radius : float
        Of the disc; it grows by a quarter while the shape has several pieces or leaves points out [m].
    rules : CourtyardRules or None
        Which holes are courtyards; None = none.

    Returns
    -------
    outline : Outline
        Vertices are points.
    reasons : list of str
        What was out of the ordinary.
    """
    reasons: list[str] = []
    shape = alpha_shape(xy, radius, regularised=True)
    attempts = 0
    while not _is_whole(shape) and math.isfinite(shape.alpha):
        attempts += 1
        larger = radius * _GROWTH**attempts if attempts < _MAX_ATTEMPTS else math.inf
        shape = alpha_shape(xy, larger, regularised=True)
    if attempts:
        reasons.append("the alpha shape's disc was enlarged until it held all points in one piece")
    whole = shape.polygons[0] if _is_whole(shape) else shapely.convex_hull(shapely.multipoints(xy))
    exterior, *holes = (shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(whole))
    kept = []
    for hole in holes if rules is not None else []:
        refusal = _refusal(hole, exterior, rules)
        if refusal is None:
            kept.append(hole)
        elif refusal and refusal not in reasons:
            reasons.append(refusal)
    return Outline(exterior, tuple(kept)).oriented(), reasons


def _refusal(
    hole: NDArray[np.float64], exterior: NDArray[np.float64], rules: CourtyardRules | None
) -> str | None:
    """Say why a hole is no courtyard; nothing to say of small ones, None if it is one."""
    if rules is None:
        return ""
    polygon = shapely.polygons(hole)
    disc = shapely.maximum_inscribed_circle(polygon, tolerance=0.01 * rules.radius)
    if shapely.length(disc) < rules.radius:
        return ""
    rim, limit = shapely.linearrings(hole), shapely.linearrings(exterior)
    narrow = shapely.length(shapely.intersection(rim, shapely.buffer(limit, rules.min_band)))
    return rules.refusal(hole, float(narrow / shapely.length(rim)))


def _is_whole(shape: AlphaShape) -> bool:
    """Whether a shape has one piece that all points belong to."""
    if len(np.unique(shape.triangles)) < len(shape.points):
        return False
    return len(shape.polygons) == 1
