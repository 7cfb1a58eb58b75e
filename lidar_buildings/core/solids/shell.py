"""Closed shells of planar faces, and the slope, direction and area of a face."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import numpy as np

from lidar_buildings.core.model.array_types import FloatArray

GROUND_SURFACE = "GroundSurface"
ROOF_SURFACE = "RoofSurface"
WALL_SURFACE = "WallSurface"
OUTER_CEILING_SURFACE = "OuterCeilingSurface"  # of overhangs, from below

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


#: A face less steep than this has no direction [deg]: at a millimetre's rounding there is nothing in it.
_LEVEL = 0.05


class FaceShape(NamedTuple):
    """How a face lies in space."""

    slope_deg: float  #: angle between the face and the horizontal plane, 0 to 180: above 90 it faces down
    #: Where the face looks, clockwise from the y axis (grid north), 0 to 360; None for level faces.
    azimuth_deg: float | None
    area: float  #: in the face's own plane [m²]


def face_shape(rings: Sequence[FloatArray]) -> FaceShape:
    """Measure a face: the exterior, counter-clockwise seen from where it looks to, then its holes [m]."""
    x, y, z = area_vector(rings)
    plan = math.hypot(x, y)
    slope = math.degrees(math.atan2(plan, z))
    is_level = min(slope, 180.0 - slope) < _LEVEL
    azimuth = None if is_level else math.degrees(math.atan2(x, y)) % 360.0
    return FaceShape(slope, azimuth, math.hypot(plan, z))


def face_plane(rings: Sequence[FloatArray]) -> tuple[float, float, float] | None:
    """
    Return a, b and c of the plane z = a x + b y + c that a face lies in, None if it does not look up.

    It passes through the middle of the exterior's vertices, which are rounded [m/m], [m].
    """
    x, y, z = area_vector(rings)
    if z <= 0.0:
        return None
    east, north, up = rings[0].mean(axis=0).tolist()
    a, b = -x / z, -y / z
    return a, b, up - a * east - b * north


def area_vector(rings: Sequence[FloatArray]) -> tuple[float, float, float]:
    """Return a face's normal, as long as its area (Newell's method) [m²]; holes run the other way."""
    x = y = z = 0.0
    for ring in rings:
        corners = (ring - ring[0]).tolist()
        for (ax, ay, az), (bx, by, bz) in zip(corners, [*corners[1:], corners[0]], strict=True):
            x += ay * bz - az * by
            y += az * bx - ax * bz
            z += ax * by - ay * bx
    return 0.5 * x, 0.5 * y, 0.5 * z
