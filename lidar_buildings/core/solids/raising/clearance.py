"""Whether the edges of a plan keep clear of each other."""

from __future__ import annotations

import numpy as np
from numba import njit

from lidar_buildings.core.model.array_types import FloatArray, IntArray


def keep_clear(edges: IntArray, distance: float) -> bool:
    """
    Whether edges meet in common ends only, and lie farther than a distance from the ends of others.

    Parameters
    ----------
    edges : ndarray of shape (n, 4)
        x and y of the start, which lies no further east, and of the end; rising by the start's x.
    distance : float
        In the unit of the edges; they are all longer.
    """
    return bool(_keep_clear(edges.astype(np.float64), distance))


@njit(cache=True, nogil=True)
def _keep_clear(edges: FloatArray, distance: float) -> bool:
    """Sweep the edges from west to east; sides of points are exact for whole numbers."""
    square = distance * distance
    for i in range(len(edges)):
        ax, ay, bx, by = edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3]
        low, high = min(ay, by) - distance, max(ay, by) + distance
        ux, uy = bx - ax, by - ay
        if ux * ux + uy * uy <= square:
            return False
        for j in range(i + 1, len(edges)):
            cx, cy, dx, dy = edges[j, 0], edges[j, 1], edges[j, 2], edges[j, 3]
            if cx > bx + distance:
                break
            if (cy < low and dy < low) or (cy > high and dy > high):
                continue
            a_shared = (ax == cx and ay == cy) or (ax == dx and ay == dy)
            b_shared = (bx == cx and by == cy) or (bx == dx and by == dy)
            c_shared = (cx == ax and cy == ay) or (cx == bx and cy == by)
            d_shared = (dx == ax and dy == ay) or (dx == bx and dy == by)
            vx, vy = dx - cx, dy - cy
            if not (
                (c_shared or _squared(cx - ax, cy - ay, ux, uy) > square)
                and (d_shared or _squared(dx - ax, dy - ay, ux, uy) > square)
                and (a_shared or _squared(ax - cx, ay - cy, vx, vy) > square)
                and (b_shared or _squared(bx - cx, by - cy, vx, vy) > square)
            ):
                return False
            c_left, d_left = ux * (cy - ay) - uy * (cx - ax), ux * (dy - ay) - uy * (dx - ax)
            a_left, b_left = vx * (ay - cy) - vy * (ax - cx), vx * (by - cy) - vy * (bx - cx)
            if c_left * d_left < 0.0 and a_left * b_left < 0.0:
                return False
    return True


@njit(cache=True, nogil=True)
def _squared(x: float, y: float, ux: float, uy: float) -> float:
    """Return the squared distance of a place to a segment, both seen from the segment's start."""
    share = min(1.0, max(0.0, (x * ux + y * uy) / (ux * ux + uy * uy)))
    return (x - share * ux) ** 2 + (y - share * uy) ** 2
