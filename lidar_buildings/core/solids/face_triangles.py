"""
Faces of solids divided into triangles for files, so that the triangles of a closed shell are closed, too.

By mapbox-earcut, not as the checks do it: of 10,397 faces of `bench.models.solids` 6,676 would be written
with other diagonals.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import accumulate, chain, pairwise

import mapbox_earcut
import numpy as np

from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.solids.shell import Face, cross, ring_edges

#: Rows of three vertices, counter-clockwise as their face is.
Triangle = tuple[int, int, int]
_Edge = tuple[int, int]


def face_pieces(vertices: FloatArray, faces: Sequence[Face]) -> list[list[tuple[int, ...]]]:
    """
    Divide each face of a solid into convex pieces that have every edge of its rings as an edge.

    Ears are cut off in the plane that shows the face largest (mapbox-earcut). That leaves out vertices in the
    middle of a straight edge, at which the next face would not match; the triangles beside them are divided.

    Parameters
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        The solid's vertices [m].
    faces : sequence of Face
        Their rings as rows of `vertices`.

    Returns
    -------
    list of list of tuple of int
        Rows of `vertices`, face by face: the face itself if it is a triangle or a convex quadrilateral, else
        triangles; empty for a face without area.
    """
    pieces: list[list[tuple[int, ...]]] = [list(face) for face in faces]
    fours = [k for k, face in enumerate(faces) if len(face) == 1 and len(face[0]) == 4]
    corners = np.array([faces[k][0] for k in fours], dtype=np.intp).reshape(-1, 4)
    whole = {k for k, is_convex in zip(fours, _are_convex(vertices[corners]), strict=True) if is_convex}
    others = [k for k, face in enumerate(faces) if k not in whole and (len(face) > 1 or len(face[0]) != 3)]
    for k, triangles in zip(others, _triangles(vertices, [faces[k] for k in others]), strict=True):
        pieces[k] = list(triangles)
    return pieces


def triangles_of(pieces: Sequence[tuple[int, ...]]) -> list[Triangle]:
    """Divide convex pieces of three or four corners into triangles."""
    return [(piece[0], piece[k], piece[k + 1]) for piece in pieces for k in range(1, len(piece) - 1)]


def _are_convex(corners: FloatArray) -> BoolArray:
    """Whether all four corners turn the same way, for rings of shape (n, 4, 3)."""
    sides = np.roll(corners, -1, axis=1) - corners
    first = cross(sides[:, 3], sides[:, 0])
    turns = [cross(sides[:, k], sides[:, k + 1]) for k in range(3)]
    return np.all([(first * turn).sum(axis=1) > 0.0 for turn in turns], axis=0)


def _triangles(vertices: FloatArray, faces: Sequence[Face]) -> Iterable[list[Triangle]]:
    """Yield each face's triangles."""
    if not faces:
        return
    rows = np.fromiter(chain.from_iterable(chain.from_iterable(faces)), dtype=np.intp)
    plan = _largest_views(vertices, faces, rows)
    cuts, first = [], 0
    for face in faces:
        ends = np.array(list(accumulate(map(len, face))), dtype=np.uint32)
        last = first + int(ends[-1])
        cuts.append(mapbox_earcut.triangulate_float64(plan[first:last], ends).reshape(-1, 3) + first)
        first = last
    cut = np.concatenate(cuts)
    (ax, ay), (bx, by), (cx, cy) = (plan[cut[:, k]].T for k in range(3))
    is_turned = (bx - ax) * (cy - ay) < (cx - ax) * (by - ay)
    cut[is_turned] = cut[is_turned][:, [0, 2, 1]]
    triangles = list(map(tuple, rows[cut].tolist()))
    for face, (start, end) in zip(faces, pairwise(accumulate(map(len, cuts), initial=0)), strict=True):
        own = triangles[start:end]
        is_whole = len(face) == 1 and len(own) == len(face[0]) - 2
        yield own if is_whole else _split_at_vertices(own, face, vertices)


def _largest_views(vertices: FloatArray, faces: Sequence[Face], rows: IntArray) -> FloatArray:
    """
    Return the vertices of faces, ring by ring, without the coordinate along which their face looks.

    Exteriors are counter-clockwise. Normals are those of `face_shape.area_vector`, all at once.
    """
    sizes = [len(ring) for face in faces for ring in face]
    start = np.repeat(list(accumulate(sizes[:-1], initial=0)), sizes)
    number = np.repeat(np.arange(len(faces)), [sum(map(len, face)) for face in faces])
    follows = np.arange(1, len(rows) + 1)
    is_last = np.cumsum(sizes) - 1
    follows[is_last] = start[is_last]
    corners = vertices[rows] - vertices[rows[start]]
    areas = cross(corners, corners[follows])
    normals = np.column_stack([np.bincount(number, areas[:, k]) for k in range(3)])
    axis = np.abs(normals).argmax(axis=1)
    looks_back = normals[np.arange(len(faces)), axis] < 0.0
    first, second = (axis + 1 + looks_back) % 3, (axis + 2 - looks_back) % 3
    columns = np.column_stack([first, second])[number]
    return np.take_along_axis(vertices[rows], columns, axis=1)


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
