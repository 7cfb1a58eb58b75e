"""Faces of solids divided into triangles for files: those of a closed shell are closed, too."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from lidar_buildings.core.model.array_types import BoolArray, FloatArray
from lidar_buildings.core.solids.shell import Face, Solid, cross
from lidar_buildings.core.solids.validity.face_arrays import face_arrays, fitted_planes
from lidar_buildings.core.solids.validity.triangulation import triangulate

#: Rows of three vertices, counter-clockwise as their face is.
Triangle = tuple[int, int, int]


def face_pieces(vertices: FloatArray, faces: Sequence[Face]) -> list[list[tuple[int, ...]]]:
    """
    Divide each face of a solid into convex pieces that have every edge of its rings as an edge.

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
        the triangles by which it is checked.
    """
    pieces: list[list[tuple[int, ...]]] = [list(face) for face in faces]
    fours = [k for k, face in enumerate(faces) if len(face) == 1 and len(face[0]) == 4]
    corners = np.array([faces[k][0] for k in fours], dtype=np.intp).reshape(-1, 4)
    whole = {k for k, is_convex in zip(fours, _are_convex(vertices[corners]), strict=True) if is_convex}
    others = [k for k, face in enumerate(faces) if k not in whole and (len(face) > 1 or len(face[0]) != 3)]
    if others:
        arrays = face_arrays(Solid(vertices, tuple(faces[k] for k in others), ()))
        triangles, face_of = triangulate(arrays, fitted_planes(arrays)[1])
        rows = list(map(tuple, triangles.tolist()))
        first = np.searchsorted(face_of, np.arange(len(others) + 1)).tolist()
        for k, (begin, end) in zip(others, pairwise(first), strict=True):
            pieces[k] = rows[begin:end]
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
