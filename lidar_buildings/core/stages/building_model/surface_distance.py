"""Distance of points to the surface of a solid."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.few_rows import rows_by_number
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.solids.validity.face_arrays import face_arrays

#: Points a block, the strips that they are sorted in, and how far those of one class reach at most [m].
_BLOCK, _STRIP = 32, 4.0
_REACHES = np.array([0.1, 0.3, 1.0, 3.0, 10.0, 1e300])


def distance_to_surface(points: FloatArray, solid: Solid, at_most: FloatArray) -> FloatArray:
    """
    Return each point's distance to the nearest face of a solid [m]: roof, walls and ground all count.

    `at_most` is known to be no smaller than the one sought, as the distance to a plane; infinite if unknown.
    """
    faces = face_arrays(solid)
    starts = faces.ring_starts
    first_corner, first_ring = starts + np.arange(len(starts)), faces.face_starts
    # Rings are closed: the first corner comes once more.
    rows = np.empty(first_corner[-1], dtype=np.int64)
    is_last = np.zeros(len(rows), dtype=np.bool_)
    is_last[first_corner[1:] - 1] = True
    rows[is_last], rows[~is_last] = faces.corners[starts[:-1]], faces.corners
    corners = solid.vertices[rows]
    # Points that lie together and reach as far, side by side: faces pass over whole blocks of them.
    strip = np.floor(points[:, 0] / _STRIP)
    strip -= strip.min(initial=0.0)
    n_strips = strip.max(initial=0.0) + 1.0
    place = _REACHES.searchsorted(at_most, side="right") * n_strips + strip
    order = np.argsort(points[:, 1])
    order = order[rows_by_number(place[order].astype(np.int64), len(_REACHES) * int(n_strips))]
    found = np.array(at_most[order], dtype=np.float64)
    _nearest(np.ascontiguousarray(points[order]), corners, first_corner, first_ring, found)
    distance = np.empty_like(found)
    distance[order] = found
    return distance


@kernel
def _nearest(
    points: FloatArray,
    corners: FloatArray,
    first_corner: IntArray,
    first_ring: IntArray,
    distance: FloatArray,
) -> None:
    low, high = np.empty(3), np.empty(3)
    n_blocks = (len(points) + _BLOCK - 1) // _BLOCK
    lowest, highest, reaches = np.empty((n_blocks, 3)), np.empty((n_blocks, 3)), np.full(n_blocks, np.inf)
    for block in range(n_blocks):
        first, last = block * _BLOCK, min(block * _BLOCK + _BLOCK, len(points))
        for axis in range(3):
            lowest[block, axis] = highest[block, axis] = points[first, axis]
            for i in range(first + 1, last):
                lowest[block, axis] = min(lowest[block, axis], points[i, axis])
                highest[block, axis] = max(highest[block, axis], points[i, axis])
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
        for block in range(n_blocks):
            is_beyond = False
            for axis in range(3):
                is_beyond |= highest[block, axis] < low[axis] - reaches[block]
                is_beyond |= lowest[block, axis] > high[axis] + reaches[block]
            if is_beyond:
                continue
            first, last = block * _BLOCK, min(block * _BLOCK + _BLOCK, len(points))
            for i in range(first, last):
                reach, is_beyond = distance[i], False
                for axis in range(3):
                    is_beyond |= points[i, axis] < low[axis] - reach
                    is_beyond |= points[i, axis] > high[axis] + reach
                if is_beyond:
                    continue
                x, y, z = points[i, 0], points[i, 1], points[i, 2]
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
            reaches[block] = distance[first]
            for i in range(first + 1, last):
                reaches[block] = max(reaches[block], distance[i])
