"""
Which roof each point of a reference is of: that of a polygon, or a part of the cloud that hangs together.

"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from lidar_buildings.core.alpha_shape_mesh import one_per_place, scaled_mesh, to_scale

#: What a point of no roof has in place of a number.
NO_ROOF = -1


def roofs_of_polygons(points: ArrayLike, polygons: ArrayLike) -> NDArray[np.int64]:
    """
    Return the row of the polygon that each point lies in or on, of several the first; −1 for none.

    Parameters
    ----------
    points : array_like of shape (n_points, 2 or more)
        In any order [m].
    polygons : array_like of shapely.Polygon or MultiPolygon
        One geometry per roof or block; invalid ones are repaired [m].

    """
    given = np.atleast_1d(np.asarray(polygons, dtype=object))
    valid = shapely.make_valid(given)
    plan = np.asarray(points, dtype=np.float64)[:, :2]
    order = np.argsort(plan[:, 0], kind="stable")
    x, y = np.ascontiguousarray(plan[order].T)
    roof = np.full(len(plan), NO_ROOF, dtype=np.int64)
    # From the last to the first, so that the first one stays.
    for row in range(len(valid) - 1, -1, -1):
        polygon = valid[row]
        if polygon is None or polygon.is_empty:
            continue
        west, _, east, _ = polygon.bounds
        begin, end = np.searchsorted(x, west, "left"), np.searchsorted(x, east, "right")
        shapely.prepare(polygon)
        inside = np.asarray(shapely.intersects_xy(polygon, x[begin:end], y[begin:end]), dtype=bool)
        roof[order[begin:end][inside]] = row
    return roof


def roofs_of_points(points: ArrayLike, gap: float, *, min_points: int = 1) -> NDArray[np.int64]:
    """
    Number the parts of a cloud that hang together in plan, from west to east; −1 for too small ones.

    Points no further apart than the gap belong together: the components of the Delaunay triangulation's
    sides up to that length, which holds the shortest way between any two points (Toussaint 1980).

    Parameters
    ----------
    points : array_like of shape (n_points, 2 or more)
        Roof points in any order [m].
    gap : float
        Distance that parts the points [m], > 0.
    min_points : int
        Parts of fewer points are no roofs.

    Returns
    -------
    ndarray of int64, shape (n_points,)
        Numbers follow the parts' westernmost points, of as western ones the southernmost.

    """
    plan = np.asarray(points, dtype=np.float64)[:, :2]
    if not len(plan):
        return np.zeros(0, dtype=np.int64)
    local, exponent = to_scale(plan)
    places, place_of, _ = one_per_place(local)
    part = _parts(places, float(np.ldexp(gap, exponent)))[place_of]
    # Places are in order from the west: a part's number is that of its first place among the large ones.
    large = np.bincount(part)[: part.max() + 1] >= min_points
    number = np.where(large, np.cumsum(large) - 1, NO_ROOF)
    return np.asarray(number[part], dtype=np.int64)


def _parts(places: NDArray[np.float64], gap: float) -> NDArray[np.int64]:
    """
    Number the components of distinct places, in the order of each one's first place.

    """
    if len(places) < 2:
        return np.zeros(len(places), dtype=np.int64)
    mesh = scaled_mesh(places, gap)
    sides = mesh.sides(np.ones(mesh.triangles.shape, dtype=bool))
    sides = sides[(sides < mesh.n_points).all(axis=1)]
    near = np.hypot(*(places[sides[:, 0]] - places[sides[:, 1]]).T) <= gap
    one, other = sides[near].T
    graph = coo_array((np.ones(len(one), dtype=np.int8), (one, other)), shape=(len(places), len(places)))
    label = connected_components(graph, directed=False)[1]
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    return np.asarray(np.argsort(np.argsort(first))[inverse.reshape(-1)], dtype=np.int64)
