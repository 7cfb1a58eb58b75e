"""What a triangulation tells of a cloud's shape: a ring that always exists."""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, Delaunay, QhullError


def characteristic_ring(xy: NDArray[np.float64], max_edge: float) -> NDArray[np.int64]:
    """
    Return the rows of a simple, counter-clockwise ring round all points, distinct and not all on a line.

    The boundary of the Delaunay triangulation is worn away from outside, the longest boundary edge first,
    until none is longer than `max_edge` but where wearing on would break the ring in two: the characteristic
    shape of Duckham et al. (2008). Where no triangulation exists, the convex hull.
    """
    try:
        triangles = Delaunay(xy)
    except QhullError:
        return ConvexHull(xy, qhull_options="QJ").vertices.astype(np.int64)
    corners, neighbours = triangles.simplices, triangles.neighbors
    follower: dict[int, int] = {}
    edges: list[tuple[float, int, int, int]] = []

    def add(start: int, end: int, triangle: int) -> None:
        follower[start] = end
        heapq.heappush(edges, (-float(np.hypot(*(xy[start] - xy[end]))), start, end, triangle))

    for triangle, side in np.argwhere(neighbours < 0).tolist():
        add(int(corners[triangle, (side + 1) % 3]), int(corners[triangle, (side + 2) % 3]), triangle)
    while edges and -edges[0][0] > max_edge:
        _, start, end, triangle = heapq.heappop(edges)
        side = next(k for k in range(3) if corners[triangle, k] not in (start, end))
        tip = int(corners[triangle, side])
        if tip in follower:
            continue
        beyond_start, beyond_end = (
            int(neighbours[triangle, next(k for k in range(3) if corners[triangle, k] == far)])
            for far in (end, start)
        )
        if min(beyond_start, beyond_end) < 0:
            continue
        add(start, tip, beyond_start)
        add(tip, end, beyond_end)
    return _followed(follower)


def _followed(follower: dict[int, int]) -> NDArray[np.int64]:
    """Return the ring that the followers make up, from its first row on."""
    start = min(follower)
    ring = [start]
    while follower[ring[-1]] != start:
        ring.append(follower[ring[-1]])
    return np.array(ring, dtype=np.int64)
