"""
Faces of solids divided into triangles for files, so that the triangles of a closed shell are closed, too.

By mapbox-earcut, not as the checks do it: of 10,397 faces of `bench.models.solids` 6,676 would be written
with other diagonals.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, chain, pairwise

import mapbox_earcut
import numpy as np

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.solids.face_shape import area_vector
from lidar_buildings.core.solids.shell import Face, ring_edges

#: Rows of three vertices, counter-clockwise as their face is.
Triangle = tuple[int, int, int]
_Edge = tuple[int, int]


def face_pieces(vertices: FloatArray, face: Face) -> list[tuple[int, ...]]:
    """
    Divide a face into convex pieces that have every edge of its rings as an edge.

    Ears are cut off in the plane that shows the face largest (mapbox-earcut). That leaves out vertices in the
    middle of a straight edge, at which the next face would not match; the triangles beside them are divided.

    Parameters
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        The solid's vertices [m].
    face : Face
        Its rings as rows of `vertices`.

    Returns
    -------
    list of tuple of int
        Rows of `vertices`: the face itself if it is a triangle or a convex quadrilateral, else triangles;
        empty for a face without area.
    """
    if len(face) == 1 and (len(face[0]) == 3 or _is_convex_quadrilateral(vertices, face[0])):
        return [face[0]]
    return list(_triangles(vertices, face))


def triangles_of(pieces: Sequence[tuple[int, ...]]) -> list[Triangle]:
    """Divide convex pieces of three or four corners into triangles."""
    return [(piece[0], piece[k], piece[k + 1]) for piece in pieces for k in range(1, len(piece) - 1)]


def _triangles(vertices: FloatArray, face: Face) -> list[Triangle]:
    rows = list(chain.from_iterable(face))
    plan = _largest_view(vertices, face)
    ends = np.array(list(accumulate(map(len, face))), dtype=np.uint32)
    cut = mapbox_earcut.triangulate_float64(plan, ends).reshape(-1, 3).tolist()
    places = plan.tolist()
    turned = [_counter_clockwise(places, *corners) for corners in cut]
    triangles = [(rows[a], rows[b], rows[c]) for a, b, c in turned]
    is_whole = len(face) == 1 and len(triangles) == len(rows) - 2
    return triangles if is_whole else _split_at_vertices(triangles, face, vertices)


def _is_convex_quadrilateral(vertices: FloatArray, ring: Sequence[int]) -> bool:
    """Whether a ring has four corners, all of which turn the same way."""
    if len(ring) != 4:
        return False
    a, b, c, d = vertices[list(ring)].tolist()
    sides = [_step(a, b), _step(b, c), _step(c, d), _step(d, a)]
    x, y, z = _cross(sides[3], sides[0])
    for k in range(3):
        u, v, w = _cross(sides[k], sides[k + 1])
        if not x * u + y * v + z * w > 0.0:
            return False
    return True


def _step(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    return b[0] - a[0], b[1] - a[1], b[2] - a[2]


def _cross(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _largest_view(vertices: FloatArray, face: Face) -> FloatArray:
    """
    Return all rings' vertices without the coordinate along which the face looks, exterior counter-clockwise.
    """
    rings = [vertices[list(ring)] for ring in face]
    normal = area_vector(rings)
    axis = max(range(3), key=lambda k: abs(normal[k]))
    first, second = (axis + 1) % 3, (axis + 2) % 3
    columns = [first, second] if normal[axis] >= 0 else [second, first]
    return np.ascontiguousarray(np.concatenate(rings)[:, columns])


def _counter_clockwise(places: Sequence[Sequence[float]], a: int, b: int, c: int) -> Triangle:
    (ax, ay), (bx, by), (cx, cy) = places[a], places[b], places[c]
    return (a, b, c) if (bx - ax) * (cy - ay) >= (cx - ax) * (by - ay) else (a, c, b)


def _split_at_vertices(triangles: list[Triangle], face: Face, vertices: FloatArray) -> list[Triangle]:
    """Divide triangles along whose edges lie vertices of the face that were left out."""
    owner = {edge: number for number, triangle in enumerate(triangles) for edge in ring_edges(triangle)}
    outer = {edge for ring in face for edge in ring_edges(ring)}
    for _ in range(sum(len(ring) for ring in face)):
        bare = {edge for edge in owner if edge not in outer and edge[::-1] not in owner}
        if not bare:
            return triangles
        wanted = [edge for edge in outer if edge not in owner] + [(b, a) for a, b in bare]
        # the longest of the edges on one line is the one that passes the others' ends
        long = max(bare, key=lambda edge: (_length(vertices, edge), edge))
        path = _path(long, wanted)
        if not path:
            break
        number = owner[long]
        apex = next(corner for corner in triangles[number] if corner not in long)
        for edge in ring_edges(triangles[number]):
            del owner[edge]
        for start, end in pairwise(path):
            triangles.append((start, end, apex))
            owner.update((edge, len(triangles) - 1) for edge in ring_edges(triangles[-1]))
        triangles[number] = triangles.pop()
        owner.update((edge, number) for edge in ring_edges(triangles[number]))
    return triangles


def _path(edge: _Edge, wanted: Sequence[_Edge]) -> list[int]:
    """Return the shortest way along wanted edges from an edge's start to its end, empty if there is none."""
    steps: dict[int, list[int]] = {}
    for start, end in sorted(wanted):
        steps.setdefault(start, []).append(end)
    paths = [[edge[0]]]
    seen = {edge[0]}
    while paths:
        path = paths.pop(0)
        for step in steps.get(path[-1], []):
            if step == edge[1]:
                return [*path, step]
            if step not in seen:
                seen.add(step)
                paths.append([*path, step])
    return []


def _length(vertices: FloatArray, edge: _Edge) -> float:
    step = vertices[edge[1]] - vertices[edge[0]]
    return float(step @ step)
