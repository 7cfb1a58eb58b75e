"""One least-squares adjustment of a roof's planes, under conditions that their points may refuse."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.surfaces.roof_planes import (
    FreePlanes,
    RoofPlane,
    adjusted_planes,
    free_planes,
    plane_moments,
)

#: Conditions that hold are refused so often (Baarda 1968): one in a thousand.
_SIGNIFICANCE = 0.001
#: Of n equations, what their discrepancies may come to, squared and in units of their variances.
_CRITICAL = chdtri(np.arange(101), _SIGNIFICANCE)
#: What a test would have to find four times of five, in units of the standard deviation (Baarda 1968): where
_POWER = 4.13
#: slopes that differ by this [m/m], heights by this [m], or corners by so many of their own σ (1 m in plan),
#: would not be found, it is not said they do not.
_SLOPE_TO_FIND, _HEIGHT_TO_FIND, _CORNER_TO_FIND = 0.25, 0.5, 33.0
#: Roofs are built level to this [m/m], and level ones at one height to this [m].
_LEVEL_SIGMA, _HEIGHT_SIGMA = 0.001, 0.01


def level_planes(planes: FreePlanes) -> IntArray:
    """
    Return the number of the level surface that each roof plane is a piece of; -1 for planes that are not.

    Planes become level that by their covariance may be so, and one surface with the largest of those that may
    have its height.
    """
    slopes = planes.covariance[:, :2, :2] + _LEVEL_SIGMA**2 * np.eye(2)
    a, b = planes.coefficients[:, :2].T
    xx, xy, yy = slopes[:, 0, 0], slopes[:, 0, 1], slopes[:, 1, 1]
    square = (a * a * yy - 2.0 * a * b * xy + b * b * xx) / (xx * yy - xy * xy)
    left = planes.roof & (square <= _CRITICAL[2]) & (_POWER**2 * (xx + yy) <= _SLOPE_TO_FIND**2)
    heights, variances = planes.mean[:, 2], planes.covariance[:, 2, 2]
    surface = np.full(len(a), -1)
    while left.any():
        largest = int(np.argmax(np.where(left, planes.counts, -1.0)))
        allowed = _CRITICAL[1] * (variances + variances[largest] + _HEIGHT_SIGMA**2)
        same = left & ((heights - heights[largest]) ** 2 <= allowed)
        surface[same], left = surface.max() + 1, left & ~same
    return surface


#: Kinds of conditions: planes have a common point, are as high at a corner of the outline, as steep, fall
#: across a wall, are as high at their eaves, are dormers alike.
POINT, CORNER, SLOPE, STRIKE, LEVEL = "common points", "corners", "equal slopes", "strikes", "level"
EAVES, ALIKE = "equal eaves", "alike dormers"
#: Those that make up the roof's topology are met exactly, the others as exactly as roofs are built.
_EXACT = (POINT, CORNER)


class Condition(NamedTuple):
    """Equations between planes z = a x + b y + c about the centre: sums of zero."""

    kind: str
    planes: tuple[int, ...]  #: numbers of the planes
    sigma: float  #: standard deviation that each equation has by itself, [m] or [m/m]
    #: Of a, b, c of each plane in each equation, shape (n_equations, n_planes, 3); of a point those that
    #: follow from the planes. Behind them those of walls, the first of three.
    factors: FloatArray = np.zeros((0, 0, 3))
    xy: tuple[float, float] = (math.nan, math.nan)  #: where a common point is about the centre [m]
    walls: tuple[int, ...] = ()  #: rows of the walls that the places of its heights hang on
    #: By how much those of each plane move with each wall [m/m], shape (n_planes, n_walls, 2).
    moves: FloatArray = np.zeros((0, 0, 2))

    def near(self, coefficients: FloatArray) -> Condition:
        """Return the condition linearised at these planes: common points and shares of walls follow them."""
        own = coefficients[np.array(self.planes) - 1]
        if self.walls:
            factors = self.factors[:, : len(own)]
            of_walls = np.zeros((len(factors), len(self.walls), 3))
            of_walls[:, :, 0] = np.einsum("ek,kx,kwx->ew", factors[:, :, 2], own[:, :2], self.moves)
            return self._replace(factors=np.concatenate([factors, of_walls], axis=1))
        if self.kind != POINT:
            return self
        x, y, _ = common_point(own)
        # An unknown position is cancelled out of its planes' equations.
        position = np.ones((len(own), 3))
        position[:, :2] = own[:, :2]
        shares = np.linalg.qr(position, mode="complete")[0][:, 3:].T
        return self._replace(factors=shares[:, :, None] * np.array([x, y, 1.0]), xy=(float(x), float(y)))


#: More planes are not adjusted together: the matrix of conditions would not fit into memory.
_MOST_PLANES = 1500
#: Rounds in which common points follow the planes.
_FOLLOW_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Planes, some of them level, to which conditions can be added."""

    free: FreePlanes  #: each plane by itself
    #: Number of the level surface that a plane is a piece of; -1 for planes that are not level, shape
    #: (n_planes,).
    surface: IntArray
    #: a, b, c of z = a x + b y + c about the building's centre, shape (n_planes, 3).
    coefficients: FloatArray
    covariances: FloatArray  #: of these, shape (n_planes, 3, 3)
    held: tuple[Condition, ...] = ()
    refused: tuple[Condition, ...] = ()
    #: By how much each wall of the outline moves inwards [m], and the variance of that, shape (n_walls, 2).
    walls: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))

    @property
    def centre(self) -> FloatArray:
        """Where coefficients have their origin [m]."""
        return self.free.moments.centre

    @property
    def first(self) -> IntArray:
        """Row of the first piece of the surface that each plane is a piece of, shape (n_planes,)."""
        own = np.arange(len(self.surface))
        surface = np.where(self.surface < 0, len(own) + own, self.surface)
        _, first, number = np.unique(surface, return_index=True, return_inverse=True)
        return np.asarray(first[number])

    @property
    def planes(self) -> tuple[RoofPlane, ...]:
        """The planes; number k is item k - 1."""
        return adjusted_planes(self.free, self.coefficients, moved(self.covariances, self.free.mean))

    def under(self, conditions: Iterable[Condition]) -> Adjustment:
        """
        Return the adjustment under those conditions that the points do not refuse.

        Least squares under R x = d, where d has the variance σ² of each condition: with the planes' own
        covariance Σ, x moves by - K R x, K = Σ Rᵀ (R Σ Rᵀ + σ²)⁻¹. The condition whose discrepancy is the
        greatest beside its variance, all others given, is refused if that is beyond chance (Baarda 1968), and
        so on.
        Those of topology are then met exactly, as if σ were 0, but their σ² goes into the covariance:
        (I - K R) Σ (I - K R)ᵀ + K σ² Kᵀ.
        """
        usable = [one for one in conditions if all(self.free.roof[k - 1] for k in one.planes)]
        usable = [one.near(self.coefficients) for one in usable]
        if not usable or len(self.surface) > _MOST_PLANES:
            return self
        shown = _System.of(usable, self).would_show()
        usable = [one for one, is_shown in zip(usable, shown, strict=True) if is_shown]
        if not usable:
            return self
        is_held = _System.of(usable, self).tested()
        held = [one for one, kept in zip(usable, is_held, strict=True) if kept]
        refused = tuple(one for one, kept in zip(usable, is_held, strict=True) if not kept)
        found = self
        follow = any(one.kind == POINT or one.walls for one in held)
        for _ in range(_FOLLOW_ROUNDS if follow else min(len(held), 1)):
            held = [one.near(found.coefficients) for one in held]
            found = _System.of(held, self).solved(self)
        return replace(found, held=self.held + tuple(held), refused=self.refused + refused)


class _System(NamedTuple):
    """Conditions as equations between planes, of which the pieces of a level surface are one."""

    own: IntArray  #: row of each plane's unknown, shape (n_planes,)
    x: FloatArray  #: a, b, c, shape (n_planes, 3)
    sigma: FloatArray  #: covariances of x, shape (n_planes, 3, 3)
    group: IntArray  #: condition of each equation, shape (n_equations,)
    variance: FloatArray  #: of each equation by itself, shape (n_equations,)
    is_exact: BoolArray  #: shape (n_equations,)
    is_point: BoolArray  #: shape (n_equations,)
    #: Of each term: equation, row of the unknown, its factors (n_terms, 3), and Σ times these.
    equation: IntArray
    row: IntArray
    factor: FloatArray
    response: FloatArray

    @classmethod
    def of(cls, conditions: Sequence[Condition], adjustment: Adjustment) -> _System:
        n, (offsets, variances) = len(adjustment.surface), adjustment.walls.T
        own = np.append(adjustment.first, n + np.arange(len(offsets)))
        x, sigma = np.zeros((len(own), 3)), np.zeros((len(own), 3, 3))
        x[:n], x[n:, 0] = adjustment.coefficients, offsets
        sigma[:n], sigma[n:, 0, 0] = adjustment.covariances, variances
        sizes = [one.factors.shape[:2] for one in conditions]
        group = np.repeat(np.arange(len(sizes)), [n for n, _ in sizes])
        rows = [own[[*(k - 1 for k in one.planes), *(n + k for k in one.walls)]] for one in conditions]
        row = np.concatenate([np.tile(*each) for each in zip(rows, [n for n, _ in sizes], strict=True)])
        equation = np.repeat(np.arange(len(group)), np.repeat([n for _, n in sizes], [n for n, _ in sizes]))
        factor = np.concatenate([one.factors.reshape(-1, 3) for one in conditions])
        variance = np.array([one.sigma for one in conditions])[group] ** 2
        is_exact = np.array([one.kind in _EXACT for one in conditions])[group]
        is_point = np.array([one.kind == POINT for one in conditions])[group]
        response = np.einsum("tij,tj->ti", sigma[row], factor)
        return cls(own, x, sigma, group, variance, is_exact, is_point, equation, row, factor, response)

    def would_show(self) -> BoolArray:
        """Return which conditions the points would refuse if they did not hold; all on common points."""
        is_height = np.bincount(self.equation, np.abs(self.factor[:, 2])) > 0.0
        to_find = np.where(is_height, _HEIGHT_TO_FIND, _SLOPE_TO_FIND)
        to_find = np.where(self.is_exact, _CORNER_TO_FIND * np.sqrt(self.variance), to_find) / _POWER
        fails = ~self.is_point & (np.diag(self._matrix(self.variance)) > to_find**2)
        return np.bincount(self.group, fails) == 0.0

    def tested(self) -> BoolArray:
        """Return which conditions the points do not refuse."""
        matrix = self._matrix(self.variance)
        return _not_refused(inverted(matrix), self._discrepancies(), self.group, _CRITICAL)

    def solved(self, adjustment: Adjustment) -> Adjustment:
        """Return planes and walls under all conditions, with their covariances."""
        inverse = inverted(self._matrix(np.where(self.is_exact, 0.0, self.variance)))
        force = (inverse * self._discrepancies()).sum(axis=1)
        x, sigma = self.x.copy(), self.sigma.copy()
        np.subtract.at(x, self.row, self.response * force[self.equation, None])
        order = np.argsort(self.row, kind="stable")
        terms = self.row[order], self.equation[order], self.response[order]
        _reduce(sigma, *terms, inverse, np.where(self.is_exact, self.variance, 0.0))
        n, x, sigma = len(adjustment.surface), x[self.own], sigma[self.own]
        walls = np.column_stack([x[n:, 0], sigma[n:, 0, 0]])
        return replace(adjustment, coefficients=x[:n], covariances=sigma[:n], walls=walls)

    def _discrepancies(self) -> FloatArray:
        return np.asarray(np.bincount(self.equation, (self.factor * self.x[self.row]).sum(axis=1)), float)

    def _matrix(self, variance: FloatArray) -> FloatArray:
        matrix = np.diag(variance)
        _add_terms(matrix, self.equation, self.row, self.factor, self.response)
        return matrix


@kernel
def _add_terms(matrix, equation, row, factor, response):  # type: ignore[no-untyped-def]
    """Add R Σ Rᵀ."""
    for t in range(len(row)):
        for s in range(len(row)):
            if row[t] == row[s]:
                for i in range(3):
                    matrix[equation[t], equation[s]] += factor[t, i] * response[s, i]


#: Pivots below this share of the diagonal belong to equations that follow from others.
_DEPENDENT = 1e-6


@kernel
def inverted(matrix):  # type: ignore[no-untyped-def]
    """
    Return the inverse of a symmetric positive matrix; rows that follow from earlier ones have 0.

    By Gauss and Jordan, written out rather than left to LAPACK: its threads show in the last digits.
    """
    a, n = matrix.copy(), len(matrix)
    for k in range(n):
        pivot = a[k, k]
        if pivot <= _DEPENDENT * matrix[k, k]:
            a[k, :], a[:, k] = 0.0, 0.0
            continue
        a[k, k] = 1.0
        for j in range(n):
            a[k, j] /= pivot
        for i in range(n):
            share = a[i, k]
            if i != k and share != 0.0:
                a[i, k] = 0.0
                for j in range(n):
                    a[i, j] -= share * a[k, j]
    return a


@kernel
def _not_refused(inverse, discrepancy, group, critical):  # type: ignore[no-untyped-def]
    """Return which conditions are kept; worst first, what is refused is taken out of the inverse."""
    n = group[-1] + 1
    start, held, force = np.searchsorted(group, np.arange(n + 1)), np.ones(n, np.bool_), np.zeros(len(group))
    for i in range(len(group)):
        for j in range(len(group)):
            force[i] += inverse[i, j] * discrepancy[j]
    while True:
        worst, most = -1, 1.0
        for g in range(n):
            a, b = start[g], start[g + 1]
            if held[g]:
                own, own_force = inverse[a:b, a:b].copy(), force[a:b].copy()
                excess = (
                    _taken_out(own, own_force, np.int64(0), b - a) / critical[min(b - a, len(critical) - 1)]
                )
                if excess > most:
                    worst, most = g, excess
        if worst < 0:
            return held
        held[worst] = False
        _taken_out(inverse, force, start[worst], start[worst + 1])


@kernel
def _taken_out(inverse, force, first, end):  # type: ignore[no-untyped-def]
    """Take equations out of an inverse and its product with discrepancies; return by how much that fits."""
    square = 0.0
    for i in range(first, end):
        pivot = inverse[i, i]
        if pivot > 0.0:
            square += force[i] ** 2 / pivot
            for k in range(len(force)):
                share = inverse[k, i] / pivot
                if k != i and share != 0.0:
                    force[k] -= share * force[i]
                    for j in range(len(force)):
                        inverse[k, j] -= share * inverse[i, j]
        inverse[i, :], inverse[:, i], force[i] = 0.0, 0.0, 0.0
    return square


@kernel
def _reduce(sigma, row, equation, response, inverse, variance):  # type: ignore[no-untyped-def]
    """Take from each covariance what conditions tell; terms are sorted by row."""
    first = 0
    for last in range(1, len(row) + 1):
        if last < len(row) and row[last] == row[first]:
            continue
        gain = np.zeros((3, len(inverse)))
        for t in range(first, last):
            for e in range(len(inverse)):
                for i in range(3):
                    gain[i, e] += response[t, i] * inverse[equation[t], e]
        for i in range(3):
            for j in range(3):
                for t in range(first, last):
                    sigma[row[first], i, j] -= gain[i, equation[t]] * response[t, j]
                for e in range(len(inverse)):
                    sigma[row[first], i, j] += gain[i, e] * variance[e] * gain[j, e]
        first = last


def moved(covariances: FloatArray, by: FloatArray) -> FloatArray:
    """Return covariances of a, b, c of planes about origins that lie elsewhere, (n, 2) [m]."""
    move = np.zeros((len(by), 3, 3)) + np.eye(3)
    move[:, 2, :2] = by[:, :2]
    return np.asarray(np.einsum("kij,kjl,kml->kim", move, covariances, move))


def adjust(points: FloatArray, plane_id: NDArray[np.uint16]) -> Adjustment:
    """
    Fit all planes of a roof by orthogonal least squares; those that may be level become exactly so.

    Pieces of one level plane get one height. Planes are numbered without gaps, 0 = none; of very many each
    stays by itself. Points that lie off every plane are in none (`plane_fitting`): they need no weights here.
    """
    free = free_planes(plane_moments(points, plane_id, int(plane_id.max(initial=0))))
    coefficients, covariances = free.coefficients.copy(), moved(free.covariance, -free.mean)
    if len(coefficients) > _MOST_PLANES:
        return Adjustment(free, np.full(len(coefficients), -1), coefficients, covariances)
    surface = level_planes(free)
    level = surface >= 0
    own, weight = surface[level], 1.0 / free.covariance[level, 2, 2]
    stiff = np.bincount(own, weight)
    coefficients[level], covariances[level] = 0.0, 0.0
    coefficients[level, 2] = (np.bincount(own, weight * free.mean[level, 2]) / stiff)[own]
    covariances[level, 2, 2] = (1.0 / stiff)[own]
    held = tuple(Condition(LEVEL, (k + 1,), _LEVEL_SIGMA) for k in np.flatnonzero(level).tolist())
    return Adjustment(free, surface, coefficients, covariances, held)


@kernel
def common_point(coefficients):  # type: ignore[no-untyped-def]
    """
    Return where planes are nearest to meeting, x, y, z [m].

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
    return np.array([x, y, a * x + b * y + c])
