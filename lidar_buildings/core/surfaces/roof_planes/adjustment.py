"""Least squares of the planes of a roof, which may have to meet."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.surfaces.roof_planes.free_planes import FreePlanes, free_planes
from lidar_buildings.core.surfaces.roof_planes.level_planes import level_planes
from lidar_buildings.core.surfaces.roof_planes.moments import plane_moments
from lidar_buildings.core.surfaces.roof_planes.normal_equations import CommonVertex, solve
from lidar_buildings.core.surfaces.roof_planes.roof_plane import RoofPlane

#: A vertex may move a plane by this at its points, or by its own roughness if that is more [m].
_LEAST_MOVE, _MOST_MOVE = 0.03, 0.06
#: More planes are not adjusted together: the normal matrix would not fit into memory.
_MOST_PLANES = 1500
#: Rounds in which the positions of common vertices follow the planes.
_FOLLOW_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Planes, some of them level, to which common vertices can be added."""

    free: FreePlanes  #: each plane by itself
    #: Number of the level surface that a plane is a piece of; -1 for planes that are not level, shape
    #: (n_planes,).
    surface: IntArray
    is_joint: bool  #: whether planes are adjusted together: very many are not
    #: a, b, c of z = a x + b y + c about the building's centre, after the adjustment, shape (n_planes, 3).
    coefficients: FloatArray
    vertices: tuple[CommonVertex, ...] = ()  #: those imposed

    @property
    def centre(self) -> FloatArray:
        """Where coefficients have their origin [m]."""
        return self.free.moments.centre

    @property
    def planes(self) -> tuple[RoofPlane, ...]:
        """The planes; number k is item k - 1."""
        return _roof_planes(self.free, self.coefficients)

    def with_common_vertices(self, vertices: Sequence[CommonVertex]) -> Adjustment:
        """
        Return the adjustment with those common vertices imposed that the points allow.

        Those that pull most at planes that move too far are given up.
        """
        if not self.is_joint:
            return self
        vertices = [vertex for vertex in vertices if all(self.free.roof[k - 1] for k in vertex.planes)]
        allowed = np.clip(self.free.rms, _LEAST_MOVE, _MOST_MOVE)
        while vertices:
            coefficients, vertices, pull = self._solved(vertices)
            excess = self.free.offsets(coefficients) / allowed
            culprits = _culprits(pull, np.flatnonzero(self.free.roof & (excess > 1.0)))
            if not culprits:
                return replace(self, coefficients=coefficients, vertices=tuple(vertices))
            vertices = [vertex for k, vertex in enumerate(vertices) if k not in culprits]
        return self

    def _solved(self, vertices: list[CommonVertex]) -> tuple[FloatArray, list[CommonVertex], FloatArray]:
        """Solve, let vertices whose position is not given follow the planes, solve again, and so on."""
        coefficients = self.coefficients
        rounds = 1 if all(vertex.fixed for vertex in vertices) else _FOLLOW_ROUNDS
        for _ in range(rounds):
            vertices = [self._following(vertex, coefficients) for vertex in vertices]
            coefficients, pull = solve(self.free, self.surface, vertices, coefficients[:, :2])
        return coefficients, vertices, pull

    def _following(self, vertex: CommonVertex, coefficients: FloatArray) -> CommonVertex:
        """Move a vertex whose position is not given to where planes are nearest to meeting."""
        if vertex.fixed:
            return vertex
        xy, _ = common_point(coefficients[np.array(vertex.planes) - 1])
        return vertex._replace(xy=(float(xy[0] + self.centre[0]), float(xy[1] + self.centre[1])))


def adjust(points: FloatArray, plane_id: NDArray[np.uint16]) -> Adjustment:
    """
    Fit all planes of a roof by orthogonal least squares; those that are nearly level become exactly so.

    Pieces of one level plane get one height. Planes are numbered without gaps, 0 = none; of very many each
    stays by itself.
    """
    n_planes = int(plane_id.max(initial=0))
    free = free_planes(plane_moments(points, plane_id, n_planes))
    if n_planes > _MOST_PLANES:
        return Adjustment(free, np.full(n_planes, -1), False, free.coefficients)
    surface = level_planes(free)
    return Adjustment(free, surface, True, solve(free, surface, (), free.coefficients[:, :2])[0])


def fitted_planes(points: FloatArray, plane_id: NDArray[np.uint16]) -> tuple[RoofPlane, ...]:
    """Fit every plane to its points by orthogonal least squares, each by itself, numbered as in `adjust`."""
    free = free_planes(plane_moments(points, plane_id, int(plane_id.max(initial=0))))
    return _roof_planes(free, free.coefficients)


def _culprits(pull: FloatArray, planes: IntArray) -> set[int]:
    """Return the vertices that pull most at planes that have moved too far, one for each of these."""
    return {int(np.argmax(pull[:, k])) for k in planes if pull[:, k].any()}


@kernel
def common_point(coefficients):  # type: ignore[no-untyped-def]
    """
    Return where planes are nearest to meeting, x, y, z, and the root mean square of their misses there [m].

    Planes z = a x + b y + c that share a direction have their point far off.
    """
    n = len(coefficients)
    a, b, c = 0.0, 0.0, 0.0
    for p in coefficients:
        a, b, c = a + p[0] / n, b + p[1] / n, c + p[2] / n
    aa, ab, bb, ac, bc = 1e-9, 0.0, 1e-9, 0.0, 0.0
    for p in coefficients:
        u, v, w = p[0] - a, p[1] - b, p[2] - c
        aa, ab, bb, ac, bc = aa + u * u, ab + u * v, bb + v * v, ac + u * w, bc + v * w
    determinant = aa * bb - ab * ab
    x, y = (ab * bc - bb * ac) / determinant, (ab * ac - aa * bc) / determinant
    z = a * x + b * y + c
    miss = 0.0
    for p in coefficients:
        miss += (p[0] * x + p[1] * y + p[2] - z) ** 2 / n
    return np.array([x, y, z]), math.sqrt(miss)


def _roof_planes(free: FreePlanes, coefficients: FloatArray) -> tuple[RoofPlane, ...]:
    """Return the planes after the adjustment; walls stay as they were fitted."""
    normals, places, rms = _placed(
        free.roof, free.normals, free.mean, free.scatter, free.counts, coefficients
    )
    columns = (normals, places + free.moments.centre, rms.tolist(), free.moments.sums[:, 0].tolist())
    return tuple(
        RoofPlane(normal, place, miss, int(n)) for normal, place, miss, n in zip(*columns, strict=True)
    )


@kernel
def _placed(roof, normals, mean, scatter, counts, coefficients):  # type: ignore[no-untyped-def]
    """Return normals, a place on each plane about the centre, and the root mean square of distances."""
    normals, places, rms = normals.copy(), mean.copy(), np.empty(len(roof))
    for k in range(len(roof)):
        if roof[k]:
            a, b, c = coefficients[k]
            length = math.sqrt(a * a + b * b + 1.0)
            normals[k, 0], normals[k, 1], normals[k, 2] = -a / length, -b / length, 1.0 / length
            places[k, 2] = a * places[k, 0] + b * places[k, 1] + c
        off, square = 0.0, 0.0
        for i in range(3):
            off += normals[k, i] * (mean[k, i] - places[k, i])
            for j in range(3):
                square += normals[k, i] * scatter[k, i, j] * normals[k, j]
        rms[k] = math.sqrt(max(square / counts[k] + off * off, 0.0))
    return normals, places, rms
