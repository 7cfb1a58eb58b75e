"""Whether edges keep clear of each other."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.few_rows import sort_rows


@kernel
def n_joints(edges, distance):  # type: ignore[no-untyped-def]
    """
    Return how many pairs of edges have a common end, −1 if edges do not keep clear of each other.

    They do if they meet in common ends only, and lie farther than a distance from the ends of others. Rings
    that pass no place twice have as many joints as edges. Edges are x and y of both ends, float64 (n, 4);
    they are swept from west to east, and sides of points are exact for whole numbers.
    """
    first, order = np.empty(len(edges)), np.arange(len(edges))
    for i in range(len(edges)):
        first[i] = min(edges[i, 0], edges[i, 2])
    sort_rows(first, order, len(order))
    square, n = distance * distance, 0
    for i in range(len(order)):
        ax, ay, bx, by = edges[order[i]]
        low, high = min(ay, by) - distance, max(ay, by) + distance
        ux, uy = bx - ax, by - ay
        if ux * ux + uy * uy <= square:
            return -1
        for j in range(i + 1, len(order)):
            cx, cy, dx, dy = edges[order[j]]
            if first[j] > max(ax, bx) + distance:
                break
            if (cy < low and dy < low) or (cy > high and dy > high):
                continue
            vx, vy = dx - cx, dy - cy
            if vx * vx + vy * vy <= square:
                return -1
            a_shared = (ax == cx and ay == cy) or (ax == dx and ay == dy)
            b_shared = (bx == cx and by == cy) or (bx == dx and by == dy)
            c_shared = (cx == ax and cy == ay) or (cx == bx and cy == by)
            d_shared = (dx == ax and dy == ay) or (dx == bx and dy == by)
            if not (
                (c_shared or _squared(cx - ax, cy - ay, ux, uy) > square)
                and (d_shared or _squared(dx - ax, dy - ay, ux, uy) > square)
                and (a_shared or _squared(ax - cx, ay - cy, vx, vy) > square)
                and (b_shared or _squared(bx - cx, by - cy, vx, vy) > square)
            ):
                return -1
            c_left, d_left = ux * (cy - ay) - uy * (cx - ax), ux * (dy - ay) - uy * (dx - ax)
            a_left, b_left = vx * (ay - cy) - vy * (ax - cx), vx * (by - cy) - vy * (bx - cx)
            if c_left * d_left < 0.0 and a_left * b_left < 0.0:
                return -1
            n += a_shared + b_shared
    return n


@kernel
def _squared(x: float, y: float, ux: float, uy: float) -> float:
    """Return the squared distance of a place to a segment, both seen from the segment's start."""
    share = min(1.0, max(0.0, (x * ux + y * uy) / (ux * ux + uy * uy)))
    return (x - share * ux) ** 2 + (y - share * uy) ** 2
