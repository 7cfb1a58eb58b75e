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
    low, high = np.empty(3), np.empty(3)
    for face in range(len(first_ring) - 1):
        start, stop = first_corner[first_ring[face]], first_corner[first_ring[face + 1]]
        outer = first_corner[first_ring[face] + 1]
        # the ring's area vector, doubled (Newell)
        nx, ny, nz = 0.0, 0.0, 0.0
        x0, y0, z0 = corners[start, 0], corners[start, 1], corners[start, 2]
        for k in range(start, outer - 1):
            ax, ay, az = corners[k, 0] - x0, corners[k, 1] - y0, corners[k, 2] - z0
            bx, by, bz = corners[k + 1, 0] - x0, corners[k + 1, 1] - y0, corners[k + 1, 2] - z0
            nx += ay * bz - az * by
            ny += az * bx - ax * bz
            nz += ax * by - ay * bx
        size = np.sqrt(nx * nx + ny * ny + nz * nz)
        if size == 0.0:
            continue
        nx, ny, nz = nx / size, ny / size, nz / size
        drop = 2
        if abs(nx) >= abs(ny) and abs(nx) >= abs(nz):
            drop = 0
        elif abs(ny) >= abs(nz):
            drop = 1
        u, v = (drop + 1) % 3, (drop + 2) % 3
        for axis in range(3):
            low[axis], high[axis] = corners[start, axis], corners[start, axis]
            for k in range(start + 1, stop):
                low[axis] = min(low[axis], corners[k, axis])
                high[axis] = max(high[axis], corners[k, axis])
        for i in range(len(points)):
            reach = distance[i]
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            if (
                x < low[0] - reach
                or x > high[0] + reach
                or y < low[1] - reach
                or y > high[1] + reach
                or z < low[2] - reach
                or z > high[2] + reach
            ):
                continue
            off = (x - x0) * nx + (y - y0) * ny + (z - z0) * nz
            if abs(off) >= reach:
                continue
            fx, fy, fz = x - off * nx, y - off * ny, z - off * nz
            fu, fv = (fy, fz) if drop == 0 else (fz, fx) if drop == 1 else (fx, fy)
            is_odd, least = False, reach * reach
            for ring in range(first_ring[face], first_ring[face + 1]):
                for k in range(first_corner[ring], first_corner[ring + 1] - 1):
                    au, av, bu, bv = corners[k, u], corners[k, v], corners[k + 1, u], corners[k + 1, v]
                    if (au > fu) != (bu > fu) and fv < av + (bv - av) * (fu - au) / (bu - au):
                        is_odd = not is_odd
            if is_odd:
                distance[i] = abs(off)
                continue
            for ring in range(first_ring[face], first_ring[face + 1]):
                for k in range(first_corner[ring], first_corner[ring + 1] - 1):
                    ax, ay, az = corners[k, 0], corners[k, 1], corners[k, 2]
                    ex, ey, ez = corners[k + 1, 0] - ax, corners[k + 1, 1] - ay, corners[k + 1, 2] - az
                    px, py, pz = x - ax, y - ay, z - az
                    square, share = ex**2 + ey**2 + ez**2, 0.0
                    if square > 0.0:
                        share = min(max((ex * px + ey * py + ez * pz) / square, 0.0), 1.0)
                    dx, dy, dz = px - share * ex, py - share * ey, pz - share * ez
                    least = min(least, dx**2 + dy**2 + dz**2)
            distance[i] = np.sqrt(least)
