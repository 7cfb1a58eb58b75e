"""Distance of points to the surface of a solid."""

from __future__ import annotations

import numpy as np
from numba import njit

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.solids.shell import Solid


def distance_to_surface(points: FloatArray, solid: Solid, at_most: FloatArray) -> FloatArray:
    """
    Return each point's distance to the nearest face of a solid.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        [m].
    solid : Solid
        Roof, walls and ground all count.
    at_most : ndarray of shape (n_points,)
        A distance known to be no smaller than the one sought, as to a plane; infinite if unknown [m].

    Returns
    -------
    ndarray of shape (n_points,)
        [m].
    """
    rings = [ring for face in solid.faces for ring in face]
    rows = np.array([row for ring in rings for row in (*ring, ring[0])], dtype=np.int64)
    first_corner = np.cumsum([0, *(len(ring) + 1 for ring in rings)])
    first_ring = np.cumsum([0, *(len(face) for face in solid.faces)])
    distance = np.array(at_most, dtype=np.float64)
    corners = np.ascontiguousarray(solid.vertices[rows])
    _nearest(np.ascontiguousarray(points), corners, first_corner, first_ring, distance)
    return distance


@njit(cache=True, nogil=True)
def _nearest(
    points: FloatArray,
    corners: FloatArray,
    first_corner: IntArray,
    first_ring: IntArray,
    distance: FloatArray,
) -> None:
    for face in range(len(first_ring) - 1):
        start, stop = first_corner[first_ring[face]], first_corner[first_ring[face + 1]]
        outer = first_corner[first_ring[face] + 1]
        nx, ny, nz = _normal(corners, start, outer)
        size = np.sqrt(nx * nx + ny * ny + nz * nz)
        if size == 0.0:
            continue
        nx, ny, nz = nx / size, ny / size, nz / size
        drop = 2
        if abs(nx) >= abs(ny) and abs(nx) >= abs(nz):
            drop = 0
        elif abs(ny) >= abs(nz):
            drop = 1
        low = np.array([corners[start:stop, axis].min() for axis in range(3)])
        high = np.array([corners[start:stop, axis].max() for axis in range(3)])
        for i in range(len(points)):
            reach = distance[i]
            x, y, z = points[i]
            if (
                x < low[0] - reach
                or x > high[0] + reach
                or y < low[1] - reach
                or y > high[1] + reach
                or z < low[2] - reach
                or z > high[2] + reach
            ):
                continue
            off = (x - corners[start, 0]) * nx + (y - corners[start, 1]) * ny + (z - corners[start, 2]) * nz
            if abs(off) >= reach:
                continue
            u, v = (drop + 1) % 3, (drop + 2) % 3
            foot = np.array([x - off * nx, y - off * ny, z - off * nz])
            if _inside(foot[u], foot[v], corners, first_corner, first_ring, face, u, v):
                distance[i] = abs(off)
            else:
                distance[i] = _to_edges(points[i], corners, first_corner, first_ring, face, reach)


@njit(cache=True, nogil=True)
def _normal(corners: FloatArray, start: int, stop: int) -> tuple[float, float, float]:
    """Return a ring's area vector, doubled (Newell)."""
    nx, ny, nz = 0.0, 0.0, 0.0
    for k in range(start, stop - 1):
        ax, ay, az = corners[k] - corners[start]
        bx, by, bz = corners[k + 1] - corners[start]
        nx += ay * bz - az * by
        ny += az * bx - ax * bz
        nz += ax * by - ay * bx
    return nx, ny, nz


@njit(cache=True, nogil=True)
def _inside(
    x: float,
    y: float,
    corners: FloatArray,
    first_corner: IntArray,
    first_ring: IntArray,
    face: int,
    u: int,
    v: int,
) -> bool:
    """Whether a place lies within a face's rings (even-odd rule), seen along the dropped axis."""
    odd = False
    for ring in range(first_ring[face], first_ring[face + 1]):
        for k in range(first_corner[ring], first_corner[ring + 1] - 1):
            ax, ay, bx, by = corners[k, u], corners[k, v], corners[k + 1, u], corners[k + 1, v]
            if (ax > x) != (bx > x) and y < ay + (by - ay) * (x - ax) / (bx - ax):
                odd = not odd
    return odd


@njit(cache=True, nogil=True)
def _to_edges(
    point: FloatArray,
    corners: FloatArray,
    first_corner: IntArray,
    first_ring: IntArray,
    face: int,
    reach: float,
) -> float:
    """Return a point's distance to the nearest edge of a face, `reach` if none is nearer [m]."""
    least = reach * reach
    for ring in range(first_ring[face], first_ring[face + 1]):
        for k in range(first_corner[ring], first_corner[ring + 1] - 1):
            along, to_point = corners[k + 1] - corners[k], point - corners[k]
            square = along[0] ** 2 + along[1] ** 2 + along[2] ** 2
            share = 0.0
            if square > 0.0:
                dot = along[0] * to_point[0] + along[1] * to_point[1] + along[2] * to_point[2]
                share = min(max(dot / square, 0.0), 1.0)
            left = to_point - share * along
            least = min(least, left[0] ** 2 + left[1] ** 2 + left[2] ** 2)
    return float(np.sqrt(least))
