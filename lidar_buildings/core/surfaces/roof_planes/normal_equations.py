"""Joint least squares of planes that may be level and have common vertices."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.surfaces.roof_planes.free_planes import FreePlanes

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


class _Terms(NamedTuple):
    """The terms of vertices' equations, sums of planes' coefficients times factors that are zero."""

    #: Rows of the plane, of the vertex that the equation belongs to, and of the equation, rising, shape
    #: (n_terms,).
    plane: IntArray
    owner: IntArray
    equation: IntArray
    factor: FloatArray  #: of a, b, c, shape (n_terms, 3)


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
