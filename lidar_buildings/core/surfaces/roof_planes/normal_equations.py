"""Joint least squares of planes that may be level and have common vertices."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.surfaces.roof_planes.free_planes import FreePlanes
from lidar_buildings.core.surfaces.roof_planes.sparse_least_squares import constrained_minimum

#: A plane smoother than this counts for no more [m].
_LEAST_RMS = 0.02


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

    Least squares with equality constraints: the normal equations bordered by the constraints' (KKT system).
    `slopes` are approximate gradients, for vertices whose position is not given. Returned is also by how much
    each vertex alone moves each plane at its points, roughly [m], shape (n_vertices, n_planes).
    """
    weight = 1.0 / np.maximum(planes.rms, _LEAST_RMS) ** 2
    terms = _terms(vertices, slopes, planes.moments.centre) if len(vertices) else _NO_TERMS
    give = np.linalg.inv(planes.cost) if len(vertices) else planes.cost
    pull = np.zeros((len(vertices), len(weight)))
    level = surface >= 0
    n_surfaces = surface.max(initial=-1) + 1
    first = np.where(level, surface, n_surfaces + 3 * (np.cumsum(~level) - 1))
    n = n_surfaces + 3 * np.count_nonzero(~level)
    coefficients = _solved(
        planes.cost, give, weight, planes.counts, level, first, n, planes.coefficients, *terms, pull
    )
    return coefficients, pull


@kernel
def _solved(  # type: ignore[no-untyped-def]
    cost, give, weight, counts, level, first, n, wanted, plane, owner, equation, factor, pull
):  # fmt: skip
    """
    Return the coefficients, and add to each vertex' pull at each plane.

    The unknowns of plane k are its coefficients, from number ``first[k]`` on; c alone, which it may share,
    if it is level.
    """
    normal, target = np.zeros((n, n)), np.zeros(n)
    n_equations = equation[-1] + 1 if len(equation) > 0 else 0
    rows, values = np.zeros((n_equations, n)), np.zeros(n_equations)
    for k in range(len(cost)):
        low = 2 if level[k] else 0
        for i in range(low, 3):
            row = first[k] + i - low
            for m in range(3):
                target[row] += weight[k] * cost[k, i, m] * wanted[k, m]
            for j in range(low, 3):
                normal[row, first[k] + j - low] += weight[k] * cost[k, i, j]
    for k in range(n):
        normal[k, k] += 1e-9 * (1.0 + normal[k, k])
    for t in range(len(plane)):
        low = 2 if level[plane[t]] else 0
        for i in range(low, 3):
            rows[equation[t], first[plane[t]] + i - low] += factor[t, i]
    solution, force = constrained_minimum(normal, target, rows, values)
    coefficients = np.zeros((len(cost), 3))
    for k in range(len(cost)):
        low = 2 if level[k] else 0
        for i in range(low, 3):
            coefficients[k, i] = solution[first[k] + i - low]
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
    """The terms of vertices' equations, sums of planes' coefficients times factors that are zero."""

    #: Rows of the plane, of the vertex that the equation belongs to, and of the equation, rising, shape
    #: (n_terms,).
    plane: IntArray
    owner: IntArray
    equation: IntArray
    factor: FloatArray  #: of a, b, c, shape (n_terms, 3)


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
