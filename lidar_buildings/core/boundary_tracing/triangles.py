"""
What a triangulation tells of a cloud's shape: a ring that always exists, and the empty places inside.

"""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, Delaunay, QhullError

#: How far points are moved before they are triangulated [disc radii].
_JOGGLE = 1e-4


def characteristic_ring(xy: NDArray[np.float64], max_edge: float) -> NDArray[np.int64]:
    """
    Return the rows of a simple, counter-clockwise ring round all points.

    The boundary of the Delaunay triangulation is worn away from outside, the longest boundary edge first,
    until none is longer than `max_edge` but where wearing on would break the ring in two: the
    characteristic shape of Duckham et al. (2008). Where no triangulation exists, the convex hull.

    Parameters
    ----------
    xy : ndarray of shape (n_points, 2)
        Distinct positions, not all on a line [m].
    max_edge : float
        Edges longer than this are worn away [m].

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


def empty_discs(
    xy: NDArray[np.float64], radius: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """
    Return the largest discs that hold no point, the larger ones first.

    They are the circumscribed circles of the Delaunay triangles.

    Parameters
    ----------
    xy : ndarray of shape (n_points, 2)
        Distinct positions [m].
    radius : float
        Only discs of at least this radius are returned [m].

    Returns
    -------
    centre : ndarray of shape (n_discs, 2)
        Centres [m].
    size : ndarray of shape (n_discs,)
        Radii [m].
    corners : ndarray of int64, shape (n_discs, 3)
        The rows of the points on each disc's edge.

    """
    # Qhull is slow to no end on points of one circle or lattice: they are moved a little, always alike.
    joggle = np.random.default_rng(0).uniform(-_JOGGLE * radius, _JOGGLE * radius, xy.shape)
    try:
        corners = Delaunay(xy + joggle).simplices.astype(np.int64)
    except QhullError:
        corners = np.zeros((0, 3), dtype=np.int64)
    a = xy[corners[:, 0]]
    b, c = xy[corners[:, 1]] - a, xy[corners[:, 2]] - a
    double_area = 2.0 * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
    flat = double_area == 0
    double_area[flat] = 1.0
    bb, cc = (b**2).sum(axis=1), (c**2).sum(axis=1)
    offset = (
        np.column_stack([c[:, 1] * bb - b[:, 1] * cc, b[:, 0] * cc - c[:, 0] * bb]) / double_area[:, None]
    )
    size = np.hypot(*offset.T)
    chosen = np.flatnonzero(~flat & (size >= radius))
    # Ties are broken by the centre, so that the order of triangles has no say.
    centre = a + offset
    chosen = chosen[np.lexsort((centre[chosen, 1], centre[chosen, 0], -size[chosen]))]
    return centre[chosen], size[chosen], corners[chosen]


def _followed(follower: dict[int, int]) -> NDArray[np.int64]:
    """
    Return the ring that the followers make up, from its first row on.

    """
    start = min(follower)
    ring = [start]
    while follower[ring[-1]] != start:
        ring.append(follower[ring[-1]])
    return np.array(ring, dtype=np.int64)
