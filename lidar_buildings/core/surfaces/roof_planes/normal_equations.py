"""Joint least squares of planes under relations and with common vertices."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.surfaces.roof_planes.free_planes import FreePlanes
from lidar_buildings.core.surfaces.roof_planes.relations import Relations
from lidar_buildings.core.surfaces.roof_planes.sparse_least_squares import constrained_minimum

#: A plane smoother than this counts for no more [m].
_LEAST_RMS = 0.02


class CommonVertex(NamedTuple):
    """
    Planes that are to have one elevation at a position.

    Attributes
    ----------
    planes : tuple of int
        Numbers of the planes, two or more.
    xy : tuple of two float
        Position in plan [m].
    fixed : bool
        Whether the position is given, such as an outline's corner; otherwise it follows the planes.
    """

    planes: tuple[int, ...]
    xy: tuple[float, float]
    fixed: bool


class Unknowns(NamedTuple):
    """
    How planes depend on what is to be found.

    Attributes
    ----------
    number : ndarray of shape (n_planes, 3), int64
        Numbers of the three unknowns that a plane depends on.
    share : ndarray of shape (n_planes, 3, 3)
        Plane k is ``share[k] @ unknowns[number[k]]``.
    n : int
        Number of unknowns.
    """

    number: IntArray
    share: FloatArray
    n: int


def unknowns_of(relations: Relations) -> Unknowns:
    """Number the unknowns: heights (shared or not), free gradients, slopes (shared or not)."""
    facing = np.isfinite(relations.azimuth) & ~relations.level
    free = ~facing & ~relations.level
    heights, n = _numbered(relations.surface, np.ones_like(free), 0, 1)
    gradients, n = _numbered(relations.surface, free, n, 2)
    slopes, n = _numbered(relations.slope, facing, n, 1)
    number = np.array([gradients, gradients, heights], dtype=np.int64).T.copy()
    number[free, 1] += 1
    number[facing, 0] = np.array(slopes, dtype=np.int64)[facing]
    share = np.zeros((len(free), 3, 3))
    share[free, 0, 0] = share[free, 1, 1] = share[:, 2, 2] = 1.0
    share[facing, 0, 0], share[facing, 1, 0] = (f(relations.azimuth[facing]) for f in (np.cos, np.sin))
    return Unknowns(number, share, n)


def _numbered(group: IntArray, kept: BoolArray, first: int, step: int) -> tuple[list[int], int]:
    """Number groups, then what is in none, from the first on in steps; return numbers and the next one."""
    groups = [g if is_kept else None for g, is_kept in zip(group.tolist(), kept.tolist(), strict=True)]
    number_of = {
        g: first + step * k for k, g in enumerate(sorted({g for g in groups if g is not None and g >= 0}))
    }
    first += step * len(number_of)
    numbers = []
    for g in groups:
        numbers.append(0 if g is None else number_of.get(g, first))
        first += 0 if g is None or g >= 0 else step
    return numbers, first


def solve(
    planes: FreePlanes,
    unknowns: Unknowns,
    vertices: Sequence[CommonVertex],
    slopes: FloatArray,
    start: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """
    Find the planes nearest to the free ones that obey all relations and meet where they should.

    Least squares with equality constraints: the normal equations bordered by the constraints' (KKT system).

    Parameters
    ----------
    planes : FreePlanes
    unknowns : Unknowns
    vertices : sequence of CommonVertex
    slopes : ndarray of shape (n_planes, 2)
        Approximate gradients, for vertices whose position is not given.
    start : ndarray of shape (n_planes, 3), optional
        Planes to change as little as need be, instead of the free ones; the unknowns are then changes.

    Returns
    -------
    coefficients : ndarray of shape (n_planes, 3)
        a, b, c about the centre.
    pull : ndarray of shape (n_vertices, n_planes)
        By how much each vertex alone moves each plane at its points, roughly [m].
    """
    weight = 1.0 / np.maximum(planes.rms, _LEAST_RMS) ** 2
    wanted = planes.coefficients if start is None else np.zeros_like(start)
    start = np.zeros_like(wanted) if start is None else start
    terms = _terms(vertices, slopes, planes.moments.centre) if len(vertices) else _NO_TERMS
    give = np.linalg.inv(planes.cost) if len(vertices) else planes.cost
    pull = np.zeros((len(vertices), len(weight)))
    coefficients = _solved(planes.cost, give, weight, planes.counts, *unknowns, wanted, start, *terms, pull)
    return coefficients, pull


@kernel
def _solved(  # type: ignore[no-untyped-def]
    cost, give, weight, counts, number, share, n, wanted, start, plane, owner, equation, factor, pull
):  # fmt: skip
    """Return the coefficients, and add to each vertex' pull at each plane."""
    normal, target = np.zeros((n, n)), np.zeros(n)
    n_equations = equation[-1] + 1 if len(equation) > 0 else 0
    rows, values = np.zeros((n_equations, n)), np.zeros(n_equations)
    for k in range(len(cost)):
        for j in range(3):
            for m in range(3):
                moved = 0.0
                for i in range(3):
                    moved += cost[k, m, i] * weight[k] * share[k, i, j]
                target[number[k, j]] += moved * wanted[k, m]
                for i in range(3):
                    normal[number[k, i], number[k, j]] += share[k, m, i] * moved
    for k in range(n):
        normal[k, k] += 1e-9 * (1.0 + normal[k, k])
    for t in range(len(plane)):
        k = plane[t]
        for i in range(3):
            values[equation[t]] -= factor[t, i] * start[k, i]
            for j in range(3):
                rows[equation[t], number[k, j]] += factor[t, i] * share[k, i, j]
    solution, force = constrained_minimum(normal, target, rows, values)
    coefficients = start.copy()
    for k in range(len(cost)):
        for i in range(3):
            for j in range(3):
                coefficients[k, i] += share[k, i, j] * solution[number[k, j]]
    # By how much the multipliers of each vertex's equations would move each plane if it were free.
    for t in range(len(plane)):
        k = plane[t]
        moved = 0.0
        for i in range(3):
            for j in range(3):
                moved += factor[t, i] * give[k, i, j] * factor[t, j]
        moved = math.sqrt(max(moved, 0.0) / counts[k])
        pull[owner[t], k] += moved * abs(force[equation[t]]) / weight[k]
    return coefficients


class _Terms(NamedTuple):
    """
    The terms of vertices' equations, sums of planes' coefficients times factors that are zero.

    Attributes
    ----------
    plane, owner, equation : ndarray of shape (n_terms,), int64
        Rows of the plane, of the vertex that the equation belongs to, and of the equation, rising.
    factor : ndarray of shape (n_terms, 3)
        Of a, b, c.
    """

    plane: IntArray
    owner: IntArray
    equation: IntArray
    factor: FloatArray


_NOTHING = np.zeros(0, dtype=np.int64)
_NO_TERMS = _Terms(_NOTHING, _NOTHING, _NOTHING, np.zeros((0, 3)))


def _terms(vertices: Sequence[CommonVertex], slopes: FloatArray, centre: FloatArray) -> _Terms:
    """
    Return the terms of vertices' equations.

    At a given position all planes have the elevation of the first. Elsewhere the position is unknown, too:
    combinations of elevations in which it cancels out are zero, three fewer than there are planes.
    """
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
    return _Terms(plane, owner, equation, np.array(factor).reshape(-1, 3))
