"""Checks of solids by ISO 19107, named by the codes of val3dity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lidar_buildings.core.model.array_types import IntArray
from lidar_buildings.core.solids.shell import Solid, cross
from lidar_buildings.core.solids.validity.codes import MARGIN, MAX_PLANE_DISTANCE, SNAP_TOLERANCE
from lidar_buildings.core.solids.validity.edges import broken_edges
from lidar_buildings.core.solids.validity.face_arrays import FaceArrays, face_arrays, fitted_planes
from lidar_buildings.core.solids.validity.intersections import self_intersects
from lidar_buildings.core.solids.validity.normals import folds
from lidar_buildings.core.solids.validity.rings import misplaced_holes, repeated_points, self_intersections
from lidar_buildings.core.solids.validity.triangulation import triangulate
from lidar_buildings.core.solids.validity.welding import weld

#: Twice the area of a triangle in plan that is surely more than nothing [m²].
_LEAST_AREA = 1e-7


def check_solid(solid: Solid) -> tuple[int, ...]:
    """
    Return the codes of everything that is wrong with a solid, rising; empty if it is valid.

    Rings are checked first, then polygons, then the shell; a level is looked at only if the one below it is
    sound, as errors there would follow from those below (Ledoux 2013, 2018). Codes, names and tolerances:
    `core.solids.validity.codes`.

    Coordinates have to be those that will be written, that is rounded. Vertices nearer to each other than the
    snap tolerance count as one; whether those exactly so far apart do depends on others' rounding: such
    solids have to be valid both ways.
    """
    if not all(face and all(face) for face in solid.faces):
        return (101,)
    return check_faces(face_arrays(solid))


def check_faces(faces: FaceArrays) -> tuple[int, ...]:
    """Return what `check_solid` does of a shell given as arrays."""
    if len(faces.face_starts) < 2 or not len(faces.vertices):
        return (902,)
    perhaps = weld(faces.vertices, SNAP_TOLERANCE * (1.0 + MARGIN))
    codes = _check_welded(faces, perhaps)
    if len(np.unique(perhaps)) < len(perhaps):
        surely = weld(faces.vertices, SNAP_TOLERANCE * (1.0 - MARGIN))
        codes |= set() if np.array_equal(surely, perhaps) else _check_welded(faces, surely)
    return tuple(sorted(codes))


def _check_welded(faces: FaceArrays, leader: IntArray) -> set[int]:
    """Return the codes of a shell whose vertices count as others."""
    faces = replace(faces, corners=leader[faces.corners])
    codes = repeated_points(faces)
    if codes:
        return codes
    codes, triangles, face_of = _check_flatness(faces)
    return codes or _check_shell(faces, triangles, face_of) | _unused(leader, faces)


def codes_of_upward_faces(faces: FaceArrays) -> tuple[int, ...] | None:
    """
    Return what is wrong with faces by themselves, None if one is not a function of its plan.

    They look upwards, with rings of three distinct vertices at least.
    """
    if not len(faces.corners):
        return ()
    codes, triangles, _ = _check_flatness(faces)
    if codes:
        return tuple(sorted(codes))
    a, b, c = faces.vertices[triangles, :2].transpose(1, 0, 2)
    u, v = b - a, c - a
    return () if (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] > _LEAST_AREA).all() else None


def _check_flatness(faces: FaceArrays) -> tuple[set[int], IntArray, IntArray]:
    """Return what is wrong with rings and planes of faces (104 and 201 to 208), and their triangles."""
    nothing = np.empty((0, 3), dtype=np.int64)
    off_plane, flat = fitted_planes(faces)
    if off_plane.max() > MAX_PLANE_DISTANCE * (1.0 - MARGIN):
        return {203} | self_intersections(faces, flat), nothing, nothing
    codes = self_intersections(faces, flat) or misplaced_holes(faces, flat)
    if codes:
        return codes, nothing, nothing
    triangles, face_of = triangulate(faces, flat)
    return {204} if folds(faces.vertices, triangles, face_of).any() else set(), triangles, face_of


def _check_shell(faces: FaceArrays, triangles: IntArray, face_of: IntArray) -> set[int]:
    """Return what is wrong with a shell of sound faces: codes 301 to 307, and 405 if it is inside out."""
    if len(faces.face_starts) <= 4:
        return {301}
    codes = broken_edges(triangles)
    if codes:
        return codes
    if self_intersects(faces.vertices, triangles, face_of):
        return {306}
    corners = faces.vertices[triangles] - faces.vertices.mean(axis=0)
    volume = np.einsum("ij,ij->", corners[:, 0], cross(corners[:, 1], corners[:, 2]))
    return {405} if volume <= 0.0 else set()


def _unused(leader: IntArray, faces: FaceArrays) -> set[int]:
    return set() if len(np.unique(faces.corners)) == len(np.unique(leader)) else {309}
