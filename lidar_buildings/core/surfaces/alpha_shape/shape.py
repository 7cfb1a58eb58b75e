"""
The alpha shape of points in the plane: which of them lie on its boundary, and the area that it encloses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.surfaces.alpha_shape.mesh import (
    circumradii,
    one_per_place,
    scaled_mesh,
    singular_sides,
    to_scale,
)

#: A disc this much smaller than alpha counts as large enough: points of one lattice then tie everywhere, or
#: nowhere, whatever the rounding.
TIE = 1e-6


@dataclass(frozen=True, eq=False)
class AlphaShape:
    """
    The alpha shape of points; rows are those of the points given, of several at one place the first.

    Attributes
    ----------
    points : ndarray of shape (n_points, 2)
        As given [m].
    alpha : float
        Radius of the disc [m].
    is_boundary : ndarray of bool, shape (n_points,)
        Whether the point lies on the alpha shape.
    edges : ndarray of int64, shape (n_edges, 2)
        The alpha shape's edges. Those along the area come first, with the area on their left; those of no
        area follow (none if regularised), the smaller row first.
    triangles : ndarray of int64, shape (n_triangles, 3)
        The Delaunay triangles that fill the area, counter-clockwise.
    n_area_edges : int
        How many of `edges` bound the area.
    """

    points: NDArray[np.float64]
    alpha: float
    is_boundary: NDArray[np.bool_]
    edges: NDArray[np.int64]
    triangles: NDArray[np.int64]
    n_area_edges: int

    @property
    def area(self) -> float:
        """Size of the area [m²]."""
        a, b, c = (self.points[self.triangles[:, k]] for k in range(3))
        u, v = b - a, c - a
        return float((u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum() / 2.0)

    @property
    def polygons(self) -> NDArray[Any]:
        """
        The area as valid polygons with holes, by their western and then southern ends; none overlaps another.

        Parts that meet in a point are polygons of their own.
        """
        rows = self.edges[: self.n_area_edges]
        faces = shapely.get_parts(shapely.polygonize(list(shapely.linestrings(self.points[rows]))))
        inside = faces[self._is_area(faces)]
        bounds = shapely.bounds(inside)
        return np.asarray(inside[np.lexsort(bounds.T[::-1])], dtype=object)

    def _is_area(self, faces: NDArray[Any]) -> NDArray[np.bool_]:
        """
        Whether each face that the edges enclose is area, not a hole: an edge of its ring has it on its left.
        """
        rings = shapely.get_exterior_ring(faces)
        coordinates, ring = shapely.get_coordinates(rings, return_index=True)
        first = np.searchsorted(ring, np.arange(len(faces)))
        start, end = coordinates[first], coordinates[first + 1]
        left = shapely.is_ccw(rings)[:, None]
        sought = np.where(left, np.hstack((start, end)), np.hstack((end, start)))
        edges = self.points[self.edges[: self.n_area_edges]].reshape(-1, 4)
        known = {tuple(edge) for edge in edges.tolist()}
        return np.array([tuple(edge) in known for edge in sought.tolist()], dtype=bool)


def alpha_shape(points: ArrayLike, alpha: float, *, regularised: bool = False) -> AlphaShape:
    """
    Return the alpha shape of points in the plane (Edelsbrunner, Kirkpatrick & Seidel 1983).

    A point lies on the alpha shape if an open disc of radius alpha without any point has it on its rim
    (*alpha-extreme*); two such points share an edge if one disc has both on its rim (*alpha-neighbours*).
    With the Delaunay triangulation: a point is extreme if a triangle at it has a circumscribed circle of
    radius alpha or more, or if it lies on the convex hull. Triangles with smaller circles fill the area.

    The general shape of 1983 has edges with no area on either side (two points nearer than 2 alpha, a row of
    points) and points without edges; these points are on the boundary, too. The regularised shape is the
    boundary of the area alone.

    Parameters
    ----------
    points : array_like of shape (n_points, 2 or more)
        In any order [m]; only x and y are looked at. Copies of a point share its fate.
    alpha : float
        Radius of the disc [m], > 0; infinity gives the convex hull with all points on its sides.
    regularised : bool
        Whether points and edges that bound no area are left out.

    Returns
    -------
    AlphaShape

    Raises
    ------
    ValueError
        If `points` has another shape or is not finite, or `alpha` is not positive.

    Notes
    -----
    Edelsbrunner and others give the disc's radius as −1/α, later authors as √α; here alpha is the radius.
    O(n log n); about 2 s for a million points. The order of points does not matter. A radius beyond 10⁴ times
    the extent of the points counts as so large: what a straight side misses by a hundred-thousandth of the
    extent is then on the hull.
    """
    plan, radius = _checked(points, alpha)
    if len(plan) == 0:
        return _without_area(plan, alpha, False)
    local, exponent = to_scale(plan)
    places, place_of, row = one_per_place(local)
    if len(places) < 2:
        return _without_area(plan, alpha, not regularised)
    mesh = scaled_mesh(places, _times_power_of_two(radius, exponent))
    size = circumradii(mesh)
    is_area = size < mesh.alpha * (1.0 - TIE)
    area_edges = mesh.sides(is_area[:, None] & ~is_area[mesh.neighbours] & (mesh.neighbours >= 0))
    if regularised:
        edges, chosen = area_edges, area_edges
    else:
        edges = np.vstack((area_edges, singular_sides(mesh, is_area)))
        chosen = mesh.triangles[~is_area]
    is_extreme = np.zeros(mesh.n_vertices, dtype=bool)
    is_extreme[chosen.ravel()] = True
    return AlphaShape(
        points=plan,
        alpha=alpha,
        is_boundary=is_extreme[: len(places)][place_of],
        edges=row[edges],
        triangles=row[mesh.triangles[is_area]],
        n_area_edges=len(area_edges),
    )


def _checked(points: ArrayLike, alpha: float) -> tuple[NDArray[np.float64], float]:
    """Return x and y, and alpha as a number."""
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] < 2:
        raise ValueError(f"points has shape {array.shape}: must be (n_points, 2) or (n_points, 3)")
    plan = np.ascontiguousarray(array[:, :2])
    finite = np.isfinite(plan).all(axis=1)
    if not finite.all():
        row = int(np.argmin(finite))
        raise ValueError(f"points[{row}] = {array[row].tolist()}: coordinates must be finite")
    radius = float(alpha)
    if math.isnan(radius) or radius <= 0.0:
        raise ValueError(f"alpha = {alpha}: must be a positive radius [m], or infinity for the convex hull")
    return plan, radius


def _without_area(plan: NDArray[np.float64], alpha: float, on_shape: bool) -> AlphaShape:
    """Return the shape of points at one place, or of none."""
    none = np.zeros((0, 3), dtype=np.int64)
    return AlphaShape(plan, alpha, np.full(len(plan), on_shape), none[:, :2], none, 0)


def _times_power_of_two(value: float, exponent: int) -> float:
    """Return value × 2^exponent, infinite where that is too large."""
    try:
        return math.ldexp(value, exponent)
    except OverflowError:
        return math.inf
