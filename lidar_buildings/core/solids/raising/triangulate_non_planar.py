"""Faces that are not flat enough, cut into triangles."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.solids.shell import ROOF_SURFACE, Face, Solid
from lidar_buildings.core.solids.validity import MAX_PLANE_DISTANCE
from lidar_buildings.core.solids.validity.face_arrays import face_arrays, fitted_planes
from lidar_buildings.core.solids.validity.normals import folds
from lidar_buildings.core.solids.validity.triangulation import triangulate


def triangulate_non_planar(solid: Solid) -> Solid:
    """Return a solid with the roof faces that are folded, or not planar, cut into triangles."""
    if not solid.faces:
        return solid
    arrays = face_arrays(solid)
    off_plane, flat = fitted_planes(arrays)
    triangles, face_of = triangulate(arrays, flat)
    is_roof = np.array([kind == ROOF_SURFACE for kind in solid.semantics])
    bent = is_roof & (folds(solid.vertices, triangles, face_of) | (off_plane > 0.5 * MAX_PLANE_DISTANCE))
    faces: list[Face] = []
    semantics: list[str] = []
    for number, (face, kind) in enumerate(zip(solid.faces, solid.semantics, strict=True)):
        parts = triangles[face_of == number].tolist() if bent[number] else []
        faces += [(tuple(part),) for part in parts] or [face]
        semantics += [kind] * (len(parts) or 1)
    return Solid(solid.vertices, tuple(faces), tuple(semantics))
