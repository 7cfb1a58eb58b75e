"""Joint least squares of the planes of a roof, which may be level and meet in common vertices."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.surfaces.roof_planes import (
    FreePlanes,
    RoofPlane,
    adjusted_planes,
    free_planes,
    plane_moments,
)

#: Levelling may move a plane by this share of its own roughness at its points,
_SHARE_OF_RMS = 0.5
#: but by no less and no more than this [m].
_LEAST_LEVELLING, _MOST_LEVELLING = 0.02, 0.04


def level_planes(planes: FreePlanes) -> IntArray:
    """
    Return the number of the level surface that each roof plane is a piece of; -1 for planes that are not.

    Planes become level that do not move more at their points than these are rough, and one surface with the
    largest of those that are as near in height.
    """
    return _level(
        planes.mean,
        planes.scatter,
        planes.counts,
        planes.normals,
        planes.rms,
        planes.coefficients,
        planes.roof,
    )


@kernel
def _level(mean, scatter, counts, normals, rms, coefficients, roof):  # type: ignore[no-untyped-def]
    """See `level_planes`."""
    n = len(counts)
    left, allowed, surface = np.empty(n, np.bool_), np.empty(n), np.full(n, -1)
    for k in range(n):
        a, b = coefficients[k, 0], coefficients[k, 1]
        square = a * a * scatter[k, 0, 0] + 2.0 * a * b * scatter[k, 0, 1] + b * b * scatter[k, 1, 1]
        moved = math.sqrt(max(square / counts[k], 0.0)) * normals[k, 2]
        allowed[k] = min(max(_SHARE_OF_RMS * rms[k], _LEAST_LEVELLING), _MOST_LEVELLING)
        left[k] = roof[k] and moved <= allowed[k]
    n_surfaces = 0
    while True:
        largest = -1
        for k in range(n):
            if left[k] and (largest < 0 or counts[k] > counts[largest]):
                largest = k
        if largest < 0:
            return surface
        for k in range(n):
            off = abs(mean[k, 2] - mean[largest, 2])
            if left[k] and off <= min(allowed[k], allowed[largest]):
                surface[k], left[k] = n_surfaces, False
        n_surfaces += 1


#: A plane smoother than this counts for no more [m].
_LEAST_RMS = 0.02
#: Pivots below this share of the diagonal belong to equations that follow from others.
_DEPENDENT = 1e-6


class CommonVertex(NamedTuple):
    """Planes that are to have one elevation at a position."""

    planes: tuple[int, ...]  #: numbers of the planes, two or more
    xy: tuple[float, float]  #: position in plan [m]
    #: Whether the position is given, such as an outline's corner; otherwise it follows the planes.
    fixed: bool


def solve(
    planes: FreePlanes, surface: IntArray, vertices: Sequence[CommonVertex], slopes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """
    Find the planes nearest to the free ones that are level and meet where they should, about the centre.

    Least squares under R x = 0: without R, x is what each plane, or level surface, is by itself, with a
    covariance N⁻¹ of its own; the multipliers f follow from R N⁻¹ Rᵀ f = R x, and move x by - N⁻¹ Rᵀ f.
    `slopes` are approximate gradients, for vertices whose position is not given. Returned is also by how much
    each vertex alone moves each plane at its points, roughly [m], shape (n_vertices, n_planes).
    """
    weight = 1.0 / np.maximum(planes.rms, _LEAST_RMS) ** 2
    level, n_surfaces = surface >= 0, int(surface.max(initial=-1)) + 1
    found, rows = planes.coefficients.copy(), weight[level, None] * planes.cost[level, 2]
    stiff = np.bincount(surface[level], rows[:, 2])
    lift = np.bincount(surface[level], (rows * found[level]).sum(axis=1))
    found[level] = 0.0
    found[level, 2] = (lift / stiff)[surface[level]]
    pull = np.zeros((len(vertices), len(weight)))
    if not len(vertices):
        return found, pull
    plane, owner, equation, factor = _terms(vertices, slopes, planes.moments.centre)
    # Unknown are c of each level surface, and a, b, c of each plane that is not level.
    own = np.where(level, surface, n_surfaces + np.cumsum(~level) - 1)
    give = np.linalg.inv(planes.cost)
    gives, x = np.zeros((own.max() + 1, 3, 3)), np.zeros((own.max() + 1, 3))
    gives[own[~level]] = give[~level] / weight[~level, None, None]
    gives[:n_surfaces, 2, 2] = 1.0 / stiff
    x[own] = found
    equations = np.zeros((equation[-1] + 1, *x.shape))
    np.add.at(equations, (equation, own[plane]), factor)
    equations[:, :n_surfaces, :2] = 0.0
    response = np.einsum("egi,gij->egj", equations, gives)
    size = (len(equations), x.size)
    force = multipliers(equations.reshape(size), response.reshape(size), x.reshape(-1))
    x -= np.einsum("e,egj->gj", force, response)
    # By how much the multipliers of each vertex' equations would move each plane if it were free.
    moved = np.einsum("ti,tij,tj->t", factor, give[plane], factor)
    moved = np.sqrt(np.maximum(moved, 0.0) / planes.counts[plane]) * np.abs(force[equation])
    np.add.at(pull, (owner, plane), moved / weight[plane])
    return x[own], pull


@kernel
def multipliers(rows, response, nearest):  # type: ignore[no-untyped-def]
    """
    Return f of R N⁻¹ Rᵀ f = R x, given R, R N⁻¹ and x; equations that follow from earlier ones have 0.

    By Cholesky, written out rather than left to LAPACK: its threads show in the last digits.
    """
    n = len(rows)
    lower, kept, x = np.zeros((n, n)), np.ones(n, dtype=np.bool_), np.zeros(n)
    for i in range(n):
        total = 0.0
        for k in range(rows.shape[1]):
            if rows[i, k] != 0.0:
                total += rows[i, k] * nearest[k]
                for j in range(i + 1):
                    lower[i, j] += rows[i, k] * response[j, k]
        diagonal = lower[i, i]
        for j in range(i):
            if kept[j]:
                for k in range(j):
                    lower[i, j] -= lower[i, k] * lower[j, k]
                lower[i, j] /= lower[j, j]
            else:
                lower[i, j] = 0.0
            lower[i, i] -= lower[i, j] ** 2
            total -= lower[i, j] * x[j]
        kept[i] = lower[i, i] > _DEPENDENT * diagonal
        if kept[i]:
            lower[i, i] = math.sqrt(lower[i, i])
            x[i] = total / lower[i, i]
        else:
            lower[i] = 0.0
    for i in range(n - 1, -1, -1):
        if kept[i]:
            for k in range(i + 1, n):
                x[i] -= lower[k, i] * x[k]
            x[i] /= lower[i, i]
    return x


def _terms(
    vertices: Sequence[CommonVertex], slopes: FloatArray, centre: FloatArray
) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
    """Return the terms of vertices' equations, sums of zero: plane, vertex, equation, factors of a, b, c."""
    # At a given position all planes have the elevation of the first; an unknown position is cancelled out.
    terms: list[tuple[int, int, int]] = []
    factor: list[tuple[float, float, float]] = []
    n_equations, (west, south) = 0, centre[:2].tolist()
    for number, vertex in enumerate(vertices):
        x, y = vertex.xy[0] - west, vertex.xy[1] - south
        if vertex.fixed:
            combinations = [[(vertex.planes[0], 1.0), (k, -1.0)] for k in vertex.planes[1:]]
        else:
            position = np.ones((len(vertex.planes), 3))
            position[:, :2] = slopes[np.array(vertex.planes) - 1]
            across = np.linalg.qr(position, mode="complete")[0][:, 3:].T.tolist()
            combinations = [list(zip(vertex.planes, shares, strict=True)) for shares in across]
        for combination in combinations:
            terms += [(k - 1, number, n_equations) for k, _ in combination]
            factor += [(share * x, share * y, share) for _, share in combination]
            n_equations += 1
    plane, owner, equation = np.array(terms, dtype=np.int64).reshape(-1, 3).T.copy()
    return plane, owner, equation, np.array(factor).reshape(-1, 3)


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
        return adjusted_planes(self.free, self.coefficients)

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
            too_far = np.flatnonzero(self.free.roof & (excess > 1.0))
            culprits = {int(np.argmax(pull[:, k])) for k in too_far if pull[:, k].any()}
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
