"""The faces of a shell as arrays: rings end to end, planes fitted, corners in their planes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain, pairwise

import numpy as np

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.solids.shell import Solid


@dataclass(frozen=True, eq=False)
class FaceArrays:
    """A shell's faces, flat."""

    vertices: FloatArray  #: map frame [m], shape (n_vertices, 3)
    corners: IntArray  #: rows of the vertices, ring by ring, shape (n_corners,)
    ring_starts: IntArray  #: where each ring begins among the corners, shape (n_rings + 1,)
    face_starts: IntArray  #: where each face begins among the rings, shape (n_faces + 1,)

    @property
    def corner_starts(self) -> IntArray:
        """Where each face begins among the corners, shape (n_faces + 1,)."""
        return self.ring_starts[self.face_starts]

    def solid(self, semantics: tuple[str, ...]) -> Solid:
        """Return the shell whose faces are these."""
        corners, starts = self.corners.tolist(), self.ring_starts.tolist()
        rings = [tuple(corners[a:b]) for a, b in pairwise(starts)]
        faces = tuple(tuple(rings[a:b]) for a, b in pairwise(self.face_starts.tolist()))
        return Solid(self.vertices, faces, semantics)


def face_arrays(solid: Solid) -> FaceArrays:
    """Return the faces of a solid."""
    rings = list(chain.from_iterable(solid.faces))
    sizes = np.array([len(ring) for ring in rings], dtype=np.int64)
    corners = np.fromiter(chain.from_iterable(rings), dtype=np.int64, count=int(sizes.sum()))
    per_face = np.array([len(face) for face in solid.faces], dtype=np.int64)
    return FaceArrays(solid.vertices, corners, starts_of(sizes), starts_of(per_face))


def fitted_planes(faces: FaceArrays) -> tuple[FloatArray, FloatArray]:
    """
    Return each face's largest distance to its plane [m], and the corners' coordinates in the planes [m].

    The planes are least-squares planes through all corners of a face. In its own plane every exterior runs
    counter-clockwise.
    """
    starts = faces.corner_starts
    counts = starts[1:] - starts[:-1]
    points = faces.vertices[faces.corners]
    centres = np.add.reduceat(points, starts[:-1]) / counts[:, None]
    offsets = points - centres.repeat(counts, axis=0)
    products = (offsets[:, :, None] * offsets[:, None, :]).reshape(-1, 9)
    moments = np.add.reduceat(products, starts[:-1]).reshape(-1, 3, 3)
    axes = np.linalg.eigh(moments)[1].repeat(counts, axis=0)
    local = np.einsum("ni,nij->nj", offsets, axes)
    off_plane = np.maximum.reduceat(np.abs(local[:, 0]), starts[:-1])
    return off_plane, _counter_clockwise(faces, local[:, 2:0:-1].copy())


def ring_areas(faces: FaceArrays, flat: FloatArray) -> FloatArray:
    """Return the area inside each ring, positive if it runs counter-clockwise [m²]."""
    following = np.arange(1, len(flat) + 1)
    following[faces.ring_starts[1:] - 1] = faces.ring_starts[:-1]
    after = flat[following]
    cross = flat[:, 0] * after[:, 1] - flat[:, 1] * after[:, 0]
    return 0.5 * np.add.reduceat(cross, faces.ring_starts[:-1])


def _counter_clockwise(faces: FaceArrays, flat: FloatArray) -> FloatArray:
    """Mirror the faces whose exteriors run clockwise."""
    clockwise = ring_areas(faces, flat)[faces.face_starts[:-1]] < 0.0
    if clockwise.any():
        flat[np.repeat(clockwise, np.diff(faces.corner_starts)), 1] *= -1.0
    return flat


def starts_of(sizes: IntArray) -> IntArray:
    """Return where each of consecutive groups begins, and where the last one ends."""
    starts = np.zeros(len(sizes) + 1, dtype=np.int64)
    sizes.cumsum(out=starts[1:])
    return starts
