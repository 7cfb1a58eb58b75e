"""The triangulation that alpha shapes are read from, and the sizes of its empty discs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.surfaces.triangulation import triangulate

#: The longer side of the points' box is brought to between half of 2^10 and 2^10, and coordinates are rounded
#: to 2^-24: by less than 10⁻¹⁰ of the extent. Sums with the frame's distance, below 2^25, are then exact.
_EXTENT_BITS, _STEP_BITS = 10, 24
#: A radius beyond so many times the longer side counts as so large.
_MAX_RADIUS = 1e4
#: How much further than a disc's diameter the frame stands off the points, so that no disc reaches both.
_STAND_OFF = 1.01


@dataclass(frozen=True, eq=False)
class ScaledMesh:
    """
    A Delaunay triangulation of points and of a frame round them that no empty disc at a point reaches.

    So discs of the radius alpha through points are empty in the mesh if they are empty of points, and the
    frame takes the place of the convex hull: every side of two points has a triangle on either side.

    Attributes
    ----------
    vertices : ndarray of shape (n_vertices, 2)
        The points, then the frame; in units of their own.
    triangles, neighbours : ndarray of shape (n_triangles, 3), int32
        Counter-clockwise; the triangle across the side opposite each corner, −1 beyond the frame.
    n_points : int
        How many of the vertices are points.
    alpha : float
        The radius in the units of the vertices.
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int32]
    neighbours: NDArray[np.int32]
    n_points: int
    alpha: float

    @property
    def n_vertices(self) -> int:
        """Number of points and of the frame's vertices."""
        return len(self.vertices)

    def sides(self, chosen: NDArray[np.bool_]) -> NDArray[np.int32]:
        """Return the sides opposite the chosen corners, shape (n, 2), each with its triangle on the left."""
        triangle, corner = np.nonzero(chosen)
        return np.column_stack([self.triangles[triangle, (corner + k) % 3] for k in (1, 2)])


def to_scale(plan: NDArray[np.float64]) -> tuple[NDArray[np.float64], int]:
    """
    Return points in the mesh's units, relative to their lower left corner, and the units' power of two.

    Points that lie within 10⁻¹⁰ of the extent come to one place.
    """
    low, high = plan.min(axis=0), plan.max(axis=0)
    # Of halves, so that not even the largest numbers overflow.
    half = float((high / 2 - low / 2).max())
    exponent = _EXTENT_BITS - 1 - math.frexp(half)[1] if half > 0.0 else 0
    local = np.ldexp(plan, exponent) - np.ldexp(low, exponent)
    return np.ldexp(np.rint(np.ldexp(local, _STEP_BITS)), -_STEP_BITS), exponent


def one_per_place(
    local: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """
    Sort points by x, then y, and take one of each place.

    Returns
    -------
    places : ndarray of shape (n_places, 2)
        The distinct points.
    place_of : ndarray of int64, shape (n_points,)
        The place of each point.
    row : ndarray of int64, shape (n_places,)
        The first row of each place.
    """
    order = np.lexsort((local[:, 1], local[:, 0]))
    ordered = local[order]
    is_first = np.ones(len(local), dtype=bool)
    is_first[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    place_of = np.empty(len(local), dtype=np.int64)
    place_of[order] = np.cumsum(is_first) - 1
    # The sort is stable: the first of a place is the one of the lowest row.
    return ordered[is_first], place_of, order[is_first].astype(np.int64)


def scaled_mesh(places: NDArray[np.float64], alpha: float) -> ScaledMesh:
    """
    Triangulate distinct points, at least two, within a frame more than 2 alpha away from them.

    Parameters
    ----------
    places : ndarray of shape (n_places, 2)
        In the mesh's units, distinct.
    alpha : float
        Radius in the same units; capped at 10⁴ times the extent.
    """
    extent = places.max(axis=0)
    radius = min(alpha, _MAX_RADIUS * float(extent.max()))
    margin = np.full(2, np.ceil(2.0 * _STAND_OFF * radius))
    tin = triangulate(np.column_stack((places, np.zeros(len(places)))), np.array([-margin, extent + margin]))
    frame = tin.vertices[len(places) :, :2] + tin.origin
    return ScaledMesh(np.vstack((places, frame)), tin.triangles, tin.neighbours, len(places), radius)


def circumradii(mesh: ScaledMesh) -> NDArray[np.float64]:
    """Return the radius of each triangle's circumscribed circle; infinite for those at the frame or flat."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    product = np.hypot(*(b - a).T) * np.hypot(*(c - b).T) * np.hypot(*(a - c).T)
    double_area = _cross(b - a, c - a)
    is_real = (mesh.triangles < mesh.n_points).all(axis=1) & (double_area > 0.0)
    return np.divide(product, 2.0 * double_area, out=np.full(len(product), np.inf), where=is_real)


def singular_sides(mesh: ScaledMesh, is_area: NDArray[np.bool_]) -> NDArray[np.int32]:
    """
    Return the alpha shape's edges without area on either side, shape (n, 2), the smaller vertex first.

    The centres of the empty discs through both ends of a side lie on its bisector between the centres of
    the circles of its two triangles, at cot(angle opposite)/2 side lengths from the side. Neither
    triangle being smaller than a disc of radius alpha, one on either side of the side has to fit between.
    """
    beyond = mesh.neighbours
    triangle_number = np.arange(len(beyond))[:, None]
    candidate = ~is_area[:, None] & ~is_area[beyond] & (beyond > triangle_number)
    triangle, corner = np.nonzero(candidate)
    sides = mesh.sides(candidate)
    real = (sides < mesh.n_points).all(axis=1)
    triangle, corner, sides = triangle[real], corner[real], sides[real]
    other = beyond[triangle, corner]
    other_corner = np.argmax(beyond[other] == triangle[:, None], axis=1)
    start, end = mesh.vertices[sides[:, 0]], mesh.vertices[sides[:, 1]]
    left = mesh.vertices[mesh.triangles[triangle, corner]]
    right = mesh.vertices[mesh.triangles[other, other_corner]]
    length = np.hypot(*(end - start).T)
    # Offset of the discs' centres from the side in half side lengths, as cotangents are.
    offset = np.sqrt(np.maximum((2.0 * mesh.alpha / length) ** 2 - 1.0, 0.0))
    fits = (
        (length <= 2.0 * mesh.alpha)
        & _reaches(start, end, left, offset)
        & _reaches(end, start, right, offset)
    )
    return np.sort(sides[fits], axis=1)


def _reaches(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    apex: NDArray[np.float64],
    offset: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Whether the cotangent of the angle at the apex, to the left of the side, is at least the offset."""
    u, v = start - apex, end - apex
    return (u * v).sum(axis=1) >= offset * np.maximum(_cross(u, v), 0.0)


def _cross(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return twice the signed areas between vectors."""
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
