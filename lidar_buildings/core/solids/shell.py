"""Closed shells of planar faces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from lidar_buildings.core.model.array_types import FloatArray

GROUND_SURFACE = "GroundSurface"
ROOF_SURFACE = "RoofSurface"
WALL_SURFACE = "WallSurface"

#: A face's rings as rows of the solid's vertices, open: its exterior, then its holes.
Face = tuple[tuple[int, ...], ...]


def ring_edges(ring: Sequence[int]) -> list[tuple[int, int]]:
    """Return the pairs of consecutive members, the last with the first."""
    return list(zip(ring, (*ring[1:], *ring[:1]), strict=True))


def cross(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the cross products of rows of three numbers, as `numpy.cross` in half the time."""
    (ax, ay, az), (bx, by, bz) = one.T, other.T
    product = np.empty(one.shape)
    product[:, 0], product[:, 1], product[:, 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return product


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed shell."""

    vertices: FloatArray  #: map frame [m], shape (n_vertices, 3)
    faces: tuple[Face, ...]  #: seen from outside, exteriors run counter-clockwise and holes clockwise
    semantics: tuple[str, ...]  #: per face GroundSurface, RoofSurface or WallSurface (the words of CityJSON)

    @property
    def volume(self) -> float:
        """Volume inside the shell [m³]; negative if its faces look inwards."""
        if not len(self.vertices):
            return 0.0
        # Gauss: signed tetrahedra over fans of triangles; what a fan adds outside a ring it takes back.
        corners = self.vertices - self.vertices[0]
        rings = [ring for face in self.faces for ring in face if len(ring) > 2]
        sizes = np.array([len(ring) for ring in rings], dtype=np.int64)
        rows = np.fromiter(chain.from_iterable(rings), dtype=np.int64, count=int(sizes.sum()))
        tips = (sizes.cumsum() - sizes).repeat(sizes - 2)
        # Rings have two triangles fewer than corners.
        ones = np.arange(1, len(tips) + 1) + np.arange(0, 2 * len(sizes), 2).repeat(sizes - 2)
        tip, one, other = (corners[rows[each]] for each in (tips, ones, ones + 1))
        return float(np.einsum("ij,ij->", tip, cross(one, other))) / 6.0

    def face_rings(self, face: Face) -> tuple[FloatArray, ...]:
        """Return the coordinates of a face's rings, each of shape (n, 3)."""
        return tuple(self.vertices[list(ring)] for ring in face)
