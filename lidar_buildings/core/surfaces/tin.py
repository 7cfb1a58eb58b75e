"""
A triangulated irregular network (TIN) over scattered points: elevation anywhere in the plane.

Made by `triangulation`; points are located by walking from triangle to triangle in compiled code.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.parallel import BLOCK, for_row_blocks


@dataclass(frozen=True, eq=False)
class Tin:
    """
    A Delaunay triangulation in the plane whose vertices carry elevations.

    A rectangular frame of virtual points, each with the elevation of the nearest vertex, surrounds the real
    vertices, so that the hull never fails, whatever the vertices, and elevations go on as at the nearest
    vertex outside it. Made by `build_tin`.
    """

    #: The real ones first, then the virtual ones; x and y relative to `origin` [m], shape (n_vertices, 3).
    vertices: NDArray[np.float64]
    triangles: NDArray[np.int32]  #: rows of `vertices`, counter-clockwise, shape (n_triangles, 3)
    #: The triangle across the side opposite each corner, −1 at the frame, shape (n_triangles, 3).
    neighbours: NDArray[np.int32]
    n_real: int  #: number of real vertices before the virtual ones
    #: Lower left and upper right corner of the frame, relative to `origin` [m], shape (2, 2).
    frame: NDArray[np.float64]
    origin: NDArray[np.float64]  #: what to add to x and y of `vertices` [m], shape (2,)

    def locate(self, xy: NDArray[np.float64]) -> NDArray[np.int32]:
        """
        Return the triangle in which (or nearest to which, beyond the frame) each point lies.

        Fastest where consecutive points are near each other.
        """
        return _locate(self._inside_frame(xy), self.vertices, self.triangles, self.neighbours)

    def elevation(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the elevation of the TIN at each point [m], by linear interpolation in its triangle."""
        return self.elevation_and_slope(xy)[0]

    def elevation_and_slope(self, xy: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Return the elevation [m] and the slope (rise over run) of the TIN at each point.

        Fastest where consecutive points are near each other; on all cores.
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


@kernel
def _locate(xy, vertices, triangles, neighbours):  # type: ignore[no-untyped-def]
    """Walk to each point's triangle, starting where the previous point was found."""
    found = np.empty(len(xy), dtype=np.int32)
    triangle = np.int32(0)
    for i in range(len(xy)):
        triangle = walk(xy[i, 0], xy[i, 1], triangle, vertices, triangles, neighbours)
        found[i] = triangle
    return found


@kernel
def walk(x, y, start, vertices, triangles, neighbours):  # type: ignore[no-untyped-def]
    """
    Cross the side that hides the point until none does (Devillers et al. 2002: visibility walk).

    Never turns straight back, so rounding on a shared side cannot make it bounce; the number of steps is
    bounded by the number of triangles. Triangles are int32, as in the mesh.
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


@kernel
def _interpolate(  # type: ignore[no-untyped-def]
    points, origin, frame, vertices, triangles, neighbours, start, elevation, slope, begin, end
):
    """Set the elevation [m] and the slope (rise over run) at points `begin` to `end`, walking along."""
    triangle, last = start, -1
    a = b = c = (0.0, 0.0, 0.0)
    steepness = 0.0
    for i in range(begin, end):
        x = min(max(points[i, 0] - origin[0], frame[0, 0]), frame[1, 0])
        y = min(max(points[i, 1] - origin[1], frame[0, 1]), frame[1, 1])
        triangle = walk(x, y, triangle, vertices, triangles, neighbours)
        if triangle != last:
            a, b, c = corners_of(triangle, vertices, triangles)
            last, steepness = triangle, plane_slope(a, b, c)
        elevation[i], slope[i] = plane_elevation(x, y, a, b, c), steepness


@kernel
def corners_of(triangle, vertices, triangles):  # type: ignore[no-untyped-def]
    """Return the coordinates of a triangle's corners."""
    a, b, c = triangles[triangle, 0], triangles[triangle, 1], triangles[triangle, 2]
    return (
        (vertices[a, 0], vertices[a, 1], vertices[a, 2]),
        (vertices[b, 0], vertices[b, 1], vertices[b, 2]),
        (vertices[c, 0], vertices[c, 1], vertices[c, 2]),
    )


@kernel
def plane_slope(a, b, c):  # type: ignore[no-untyped-def]
    """Return the rise over run of the plane through three corners; 0 for a triangle without area."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    area = ux * vy - uy * vx
    if area <= 0.0:
        return 0.0
    east, north = uy * vz - uz * vy, uz * vx - ux * vz
    return math.sqrt(east * east + north * north) / area


@kernel
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
