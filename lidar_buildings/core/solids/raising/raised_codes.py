"""Whether a raised shell is valid, told from its plan where that is enough."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.model.array_types import BoolArray
from lidar_buildings.core.solids.raising.assembly import RaisedShell
from lidar_buildings.core.solids.validity.checking import check_faces, codes_of_upward_faces
from lidar_buildings.core.solids.validity.face_arrays import FaceArrays, starts_of


def raised_codes(shell: RaisedShell) -> tuple[int, ...]:
    """
    Return what `check_solid` does of a raised shell.

    A roof is a function of the plan: where the plan's edges keep clear of each other, its pieces cannot meet
    elsewhere than along them, walls stand on edges, and all hang together as the plan does. What is left to
    check are the sloping faces by themselves, as they need not be flat to the millimetre. Only where the plan
    leaves doubt, or one of them overhangs itself, all is checked.
    """
    codes = _sloping_codes(shell) if shell.is_clean else None
    return check_faces(shell.faces) if codes is None else codes


def _sloping_codes(shell: RaisedShell) -> tuple[int, ...] | None:
    """Return what is wrong with sloping faces of the roof by themselves, None where all is to be checked."""
    sloping = _sloping(shell)
    return codes_of_upward_faces(_chosen(shell.faces, sloping)) if sloping.any() else ()


def _sloping(shell: RaisedShell) -> BoolArray:
    """Say of each face whether it is one of the roof's and not level."""
    faces = shell.faces
    z = faces.vertices[faces.corners, 2]
    first = faces.corner_starts[:-1]
    sloping = np.minimum.reduceat(z, first) < np.maximum.reduceat(z, first)
    sloping[shell.n_plan_faces :] = False
    return np.asarray(sloping)


def _chosen(faces: FaceArrays, chosen: BoolArray) -> FaceArrays:
    """Return some of the faces."""
    per_ring = faces.face_starts[1:] - faces.face_starts[:-1]
    per_corner = faces.ring_starts[1:] - faces.ring_starts[:-1]
    rings = chosen.repeat(per_ring)
    return FaceArrays(
        faces.vertices,
        faces.corners[rings.repeat(per_corner)],
        starts_of(per_corner[rings]),
        starts_of(per_ring[chosen]),
    )
