"""
A triangulated irregular network (TIN) over scattered points: elevation anywhere in the plane.

Delaunay triangles come from Qhull; points are located by walking from triangle to triangle in compiled code.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import Delaunay, cKDTree

from lidar_buildings.core.model.point_array import checked_points
from lidar_buildings.core.neighbours.cell_grid import cell_order
from lidar_buildings.core.neighbours.parallel import BLOCK, for_row_blocks

#: Virtual points per side of the frame round the vertices.
FRAME_POINTS_PER_SIDE = 16
#: Distance of the frame from what it encloses, as a share of its longer side, and at least [m].
FRAME_MARGIN, MIN_FRAME_MARGIN = 0.05, 1.0


@dataclass(frozen=True, eq=False)
class Tin:
    """
    A Delaunay triangulation in the plane whose vertices carry elevations.

    A rectangular frame of virtual points, each with the elevation of the nearest vertex, surrounds the real
    vertices, so that the hull never fails, whatever the vertices, and elevations go on as at the nearest
    vertex outside it. Made by `build_tin`.

    Attributes
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        The real ones first, ordered by x, then y; then the virtual ones; x and y relative to `origin` [m].
        A TIN that was densified has more real ones after those, some of them in no triangle.
    triangles : ndarray of shape (n_triangles, 3), int32
        Rows of `vertices`, counter-clockwise.
    neighbours : ndarray of shape (n_triangles, 3), int32
        The triangle across the side opposite each corner, −1 at the frame.
    n_real : int
        Number of real vertices before the virtual ones.
    frame : ndarray of shape (2, 2)
        Lower left and upper right corner of the frame, relative to `origin` [m].
    origin : ndarray of shape (2,)
        What to add to x and y of `vertices` [m].
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int32]
    neighbours: NDArray[np.int32]
    n_real: int
    frame: NDArray[np.float64]
    origin: NDArray[np.float64]

    def locate(self, xy: NDArray[np.float64]) -> NDArray[np.int32]:
        """
        Return the triangle in which (or nearest to which, beyond the frame) each point lies.

        Fastest where consecutive points are near each other.

        Parameters
        ----------
        xy : ndarray of shape (n_points, 2 or more)
            Only x and y are looked at [m].
        """
        return _locate(self._inside_frame(xy), self.vertices, self.triangles, self.neighbours)

    def elevation(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Return the elevation of the TIN at each point [m], by linear interpolation in its triangle.

        Parameters
        ----------
        xy : ndarray of shape (n_points, 2 or more)
            Only x and y are looked at, in any order [m].
        """
        return self.elevation_and_slope(xy)[0]

    def elevation_and_slope(self, xy: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Return the elevation [m] and the slope (rise over run) of the TIN at each point.

        Parameters
        ----------
        xy : ndarray of shape (n_points, 2 or more)
            Only x and y are looked at, in any order [m].
        """
        xy = np.asarray(xy, dtype=np.float64)[:, :2]
        order = cell_order(xy, self._typical_side())
        elevation, slope = np.empty(len(xy)), np.empty(len(xy))
        elevation[order], slope[order] = self.elevation_and_slope_along(xy[order])
        return elevation, slope

    def elevation_and_slope_along(
        self, xy: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Return the same as `elevation_and_slope` of points whose consecutive ones are near each other.

        Without sorting them first; on all cores.

        Parameters
        ----------
        xy : ndarray of shape (n_points, 2 or more), float64
            Only x and y are looked at [m].
        """
        elevation, slope = np.empty(len(xy)), np.empty(len(xy))
        mesh = (self.vertices, self.triangles, self.neighbours)
        starts = _locate(self._inside_frame(xy[::BLOCK]), *mesh)
        for_row_blocks(
            lambda a, b: _interpolate(
                xy, self.origin, self.frame, *mesh, starts[a // BLOCK], elevation, slope, a, b
            ),
            len(xy),
        )
        return elevation, slope

    def _inside_frame(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points relative to the origin, those beyond the frame moved onto it."""
        return np.clip(np.asarray(xy)[:, :2] - self.origin, *self.frame)

    def _typical_side(self) -> float:
        """Side of a square as large as two mean triangles [m]."""
        width, height = self.frame[1] - self.frame[0]
        return math.sqrt(2.0 * width * height / len(self.triangles))


def build_tin(vertices: ArrayLike, extent: NDArray[np.float64] | None = None) -> Tin:
    """
    Triangulate points; the result depends on neither their order nor their repetition.

    Of several points at one place the lowest counts. O(n log n); about 0.2 M vertices/s.

    Parameters
    ----------
    vertices : ndarray of shape (n_points, 3)
        At least one point [m]. Identical and collinear points are fine.
    extent : ndarray of shape (2, 2), optional
        Lower left and upper right corner of what the frame has to enclose as well [m].

    Raises
    ------
    ValueError
        If there is no point, the shape is wrong, or a coordinate is not finite.
    """
    vertices = checked_points(vertices)
    if len(vertices) == 0:
        raise ValueError("vertices is empty: a TIN needs at least one point")
    corners = vertices[:, :2] if extent is None else np.vstack((vertices[:, :2], extent))
    origin = np.floor(corners.min(axis=0))
    real = _one_per_place(vertices)
    real[:, :2] -= origin
    frame = _frame(corners.min(axis=0) - origin, corners.max(axis=0) - origin)
    _, nearest = cKDTree(real[:, :2]).query(frame)
    vertices = np.vstack((real, np.column_stack((frame, real[nearest, 2]))))
    mesh = Delaunay(vertices[:, :2])
    triangles, neighbours = _counter_clockwise(vertices, mesh.simplices, mesh.neighbors)
    box = np.array([frame.min(axis=0), frame.max(axis=0)])
    return Tin(vertices, triangles, neighbours, len(real), box, origin)


def height_above_ground(points: ArrayLike, ground: ArrayLike) -> NDArray[np.float64]:
    """
    Return each point's height above the TIN of the ground points [m].

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In any order [m].
    ground : ndarray of shape (n_vertices, 3), or of shape (n_points,) and bool
        The ground's points [m], or which of `points` they are; at least one.

    Raises
    ------
    ValueError
        If there is no ground point, or a shape is wrong.
    """
    points, ground = checked_points(points), np.asarray(ground)
    vertices = points[ground] if ground.dtype == np.bool_ else ground
    return points[:, 2] - build_tin(vertices).elevation(points)


def _one_per_place(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points ordered by x, then y; of those at one place only the lowest."""
    points = points[np.lexsort((points[:, 2], points[:, 1], points[:, 0]))]
    first = np.ones(len(points), dtype=bool)
    first[1:] = (points[1:, :2] != points[:-1, :2]).any(axis=1)
    return points[first]


def _frame(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points along a rectangle round the box from `low` to `high`, shape (n, 2) [m]."""
    margin = max(FRAME_MARGIN * float((high - low).max()), MIN_FRAME_MARGIN)
    (left, bottom), (right, top) = low - margin, high + margin
    share = np.arange(FRAME_POINTS_PER_SIDE) / FRAME_POINTS_PER_SIDE
    x, y = left + share * (right - left), bottom + share * (top - bottom)
    sides = (
        (x, np.full_like(x, bottom)),
        (np.full_like(y, right), y),
        ((left + right) - x, np.full_like(x, top)),
        (np.full_like(y, left), (bottom + top) - y),
    )
    return np.vstack([np.column_stack(side) for side in sides])


def _counter_clockwise(
    vertices: NDArray[np.float64], triangles: NDArray[np.int32], neighbours: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the triangles and their neighbours with every triangle turning left."""
    a, b, c = (vertices[triangles[:, k], :2] for k in range(3))
    turn = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    order = np.where((turn < 0)[:, None], [0, 2, 1], [0, 1, 2])
    return np.take_along_axis(triangles, order, axis=1), np.take_along_axis(neighbours, order, axis=1)


@njit(cache=True, nogil=True)
def _locate(xy, vertices, triangles, neighbours):  # type: ignore[no-untyped-def]
    """Walk to each point's triangle, starting where the previous point was found."""
    found = np.empty(len(xy), dtype=np.int32)
    triangle = 0
    for i in range(len(xy)):
        triangle = walk(xy[i, 0], xy[i, 1], triangle, vertices, triangles, neighbours)
        found[i] = triangle
    return found


@njit(cache=True, nogil=True)
def walk(x, y, start, vertices, triangles, neighbours):  # type: ignore[no-untyped-def]
    """
    Cross the side that hides the point until none does (Devillers et al. 2002: visibility walk).

    Never turns straight back, so rounding on a shared side cannot make it bounce; the number of steps is
    bounded by the number of triangles.
    """
    triangle, came_from = start, -1
    for _ in range(len(triangles)):
        a, b, c = triangles[triangle, 0], triangles[triangle, 1], triangles[triangle, 2]
        ax, ay, bx, by = vertices[a, 0], vertices[a, 1], vertices[b, 0], vertices[b, 1]
        cx, cy = vertices[c, 0], vertices[c, 1]
        if (cx - bx) * (y - by) - (cy - by) * (x - bx) < 0.0:
            beyond = neighbours[triangle, 0]
            if beyond >= 0 and beyond != came_from:
                triangle, came_from = beyond, triangle
                continue
        if (ax - cx) * (y - cy) - (ay - cy) * (x - cx) < 0.0:
            beyond = neighbours[triangle, 1]
            if beyond >= 0 and beyond != came_from:
                triangle, came_from = beyond, triangle
                continue
        if (bx - ax) * (y - ay) - (by - ay) * (x - ax) < 0.0:
            beyond = neighbours[triangle, 2]
            if beyond >= 0 and beyond != came_from:
                triangle, came_from = beyond, triangle
                continue
        return triangle
    return triangle


@njit(cache=True, nogil=True)
def _interpolate(  # type: ignore[no-untyped-def]
    points, origin, frame, vertices, triangles, neighbours, start, elevation, slope, begin, end
):
    """Set the elevation [m] and the slope (rise over run) at points `begin` to `end`, walking along."""
    triangle = start
    for i in range(begin, end):
        x = min(max(points[i, 0] - origin[0], frame[0, 0]), frame[1, 0])
        y = min(max(points[i, 1] - origin[1], frame[0, 1]), frame[1, 1])
        triangle = walk(x, y, triangle, vertices, triangles, neighbours)
        a, b, c = triangles[triangle, 0], triangles[triangle, 1], triangles[triangle, 2]
        elevation[i] = plane_elevation(x, y, vertices[a], vertices[b], vertices[c])
        slope[i] = plane_slope(vertices[a], vertices[b], vertices[c])


@njit(cache=True, nogil=True)
def plane_slope(a, b, c):  # type: ignore[no-untyped-def]
    """Return the rise over run of the plane through three corners; 0 for a triangle without area."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    area = ux * vy - uy * vx
    if area <= 0.0:
        return 0.0
    return math.hypot(uy * vz - uz * vy, uz * vx - ux * vz) / area


@njit(cache=True, nogil=True)
def plane_elevation(x, y, a, b, c):  # type: ignore[no-untyped-def]
    """
    Return the elevation at (x, y) of the plane through three corners [m].

    Weights are kept within the triangle, so that a needle-shaped one cannot throw a value far off; a triangle
    without area gives its first corner's elevation.
    """
    ux, uy, vx, vy = b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]
    area = ux * vy - uy * vx
    if area <= 0.0:
        return a[2]
    px, py = x - a[0], y - a[1]
    weight_b = min(max((px * vy - py * vx) / area, 0.0), 1.0)
    weight_c = min(max((ux * py - uy * px) / area, 0.0), 1.0 - weight_b)
    return a[2] + weight_b * (b[2] - a[2]) + weight_c * (c[2] - a[2])
