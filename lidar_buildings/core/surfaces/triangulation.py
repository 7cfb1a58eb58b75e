"""
A TIN of many vertices, fast: inserted one by one in an order that keeps each near the one before.

Fifteen times as fast as Qhull on the 300,000 vertices of a tile (0.28 s against 4.1 s), without the
interpreter's lock. Qhull remains where a ring needs the hull without a frame: `boundary_tracing.rings`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.point_array import checked_points, extent_of
from lidar_buildings.core.neighbours.cell_grid import cell_order
from lidar_buildings.core.surfaces.incremental_delaunay import insert_vertex
from lidar_buildings.core.surfaces.tin import Tin, walk

#: Each round of insertion has so many times the vertices of the one before.
_ROUND_GROWTH = 4
#: Vertices of the first round, and about so many vertices to a cell when a round is put in order.
_FIRST_ROUND, _PER_CELL = 100, 2.0
#: Virtual vertices on each side of the frame.
_PER_SIDE = 16
#: How far the frame stands off what it encloses: share of its longer side, and least [m]; the hull stands off
#: twice as far. Only elevations beyond the outermost vertices depend on it.
_FRAME_MARGIN, _MIN_MARGIN = 0.05, 1.0


def build_tin(vertices: ArrayLike, extent: NDArray[np.float64] | None = None) -> Tin:
    """
    Triangulate points, one at least; the result depends on neither their order nor their repetition.

    Of several points at one place the lowest counts; collinear ones are fine. Vertices are ordered by x, then
    y. ValueError as `checked_points` and `triangulate`, which says what `extent` is.
    """
    return triangulate(_one_per_place(checked_points(vertices)), extent, 0.0)


def triangulate(
    vertices: NDArray[np.float64], extent: NDArray[np.float64] | None = None, clearance: float = 1.0
) -> Tin:
    """
    Triangulate points of which no two lie at one place (Delaunay; rounds after Amenta, Choi & Rote 2003).

    A random quarter of the vertices after another is inserted, each round sorted along rows of cells, so that
    every walk to the next place is short. The triangles do not depend on the order. About 0.7 M vertices/s.
    `vertices` are (n_vertices, 3) [m]; collinear ones are fine, ValueError if there is none. `extent` is the
    lower left and upper right corner of what the frame has to enclose as well, `clearance` is added to its
    distance [m]. The mesh's real vertices are in the order given. Beyond them elevations go on as at the
    nearest vertex.
    """
    if len(vertices) == 0:
        raise ValueError("vertices is empty: a TIN needs at least one point")
    corners = extent_of(vertices)[:, :2]
    low, high = extent_of(corners if extent is None else np.vstack((corners, extent)))
    origin = np.floor(low)
    real = np.ascontiguousarray(vertices - [*origin, 0.0])
    margin = max(_FRAME_MARGIN * float((high - low).max()) + clearance, _MIN_MARGIN)
    frame, hull = (np.array([low - origin - m, high - origin + m]) for m in (margin, 2.0 * margin))
    virtual = np.vstack((_corners_of(hull), _ring_of(frame)))
    z = _elevation_of_nearest(virtual, real)
    all_vertices = np.vstack((real, np.column_stack((virtual, z))))
    triangles, neighbours = _mesh(all_vertices, len(real))
    return Tin(all_vertices, triangles, neighbours, len(real), frame, origin)


def _one_per_place(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points ordered by x, then y; of those at one place only the lowest."""
    points = points[np.lexsort((points[:, 2], points[:, 1], points[:, 0]))]
    first = np.ones(len(points), dtype=bool)
    first[1:] = (points[1:, :2] != points[:-1, :2]).any(axis=1)
    return points[first]


def _mesh(vertices: NDArray[np.float64], n_real: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Insert the frame and then the real vertices into the two triangles of the hull's corners."""
    triangles = np.full((2 * len(vertices), 3), -1, dtype=np.int32)
    neighbours = triangles.copy()
    south_west, south_east, north_east, north_west = range(n_real, n_real + 4)
    triangles[:2] = (south_west, south_east, north_east), (south_west, north_east, north_west)
    neighbours[0, 1], neighbours[1, 2] = 1, 0
    order = np.concatenate((np.arange(n_real + 4, len(vertices)), _insertion_order(vertices[:n_real])))
    n_triangles = insert_all(order, vertices, triangles, neighbours, 2)
    return triangles[:n_triangles].copy(), neighbours[:n_triangles].copy()


def _insertion_order(vertices: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the rows in the order of insertion: random rounds, each larger, each sorted by place."""
    n = len(vertices)
    shuffled = np.random.default_rng(0).permutation(n)
    area = float(np.prod(np.maximum(np.diff(extent_of(vertices)[:, :2], axis=0), _MIN_MARGIN)))
    rounds, first, last = [], 0, min(_FIRST_ROUND, n)
    while first < n:
        rows = shuffled[first:last]
        rounds.append(rows[cell_order(vertices[rows], (_PER_CELL * area / len(rows)) ** 0.5)])
        first, last = last, min(_ROUND_GROWTH * last, n)
    return np.concatenate(rounds)


def _corners_of(box: NDArray[np.float64]) -> NDArray[np.float64]:
    (west, south), (east, north) = box
    return np.array([(west, south), (east, south), (east, north), (west, north)])


def _ring_of(box: NDArray[np.float64]) -> NDArray[np.float64]:
    share = (np.arange(_PER_SIDE) / _PER_SIDE)[:, None]
    corners = _corners_of(box)
    return np.vstack(
        [a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    )


@kernel
def _elevation_of_nearest(places, vertices):  # type: ignore[no-untyped-def]
    """Return the elevation of the vertex nearest to each place; of several as near the lowest [m]."""
    elevations = np.empty(len(places))
    for i in range(len(places)):
        best, elevation = np.inf, np.inf
        for j in range(len(vertices)):
            away = (vertices[j, 0] - places[i, 0]) ** 2 + (vertices[j, 1] - places[i, 1]) ** 2
            if away < best or (away == best and vertices[j, 2] < elevation):
                best, elevation = away, vertices[j, 2]
        elevations[i] = elevation
    return elevations


@kernel
def insert_all(order, vertices, triangles, neighbours, n_triangles):  # type: ignore[no-untyped-def]
    """Insert vertices in this order, walking to each from the one before; return the number of triangles."""
    last = np.int32(0)
    for vertex in order:
        last = walk(vertices[vertex, 0], vertices[vertex, 1], last, vertices, triangles, neighbours)
        n_triangles = insert_vertex(vertex, last, n_triangles, vertices, triangles, neighbours)
    return n_triangles
