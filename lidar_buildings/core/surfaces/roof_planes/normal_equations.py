"""Joint least squares of planes under relations and with common vertices."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import FloatArray
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


def solve(
    planes: FreePlanes,
    relations: Relations,
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
    relations : Relations
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
    begin = np.cumsum([0, *(len(vertex.planes) for vertex in vertices)])
    members = np.array([k - 1 for vertex in vertices for k in vertex.planes], dtype=np.int64)
    xy = np.array([vertex.xy for vertex in vertices]).reshape(-1, 2) - planes.moments.centre[:2]
    is_fixed = np.array([vertex.fixed for vertex in vertices], dtype=np.bool_)
    pull = np.zeros((len(vertices), len(weight)))
    coefficients = _solved(
        planes.cost, weight, planes.counts, *relations, wanted, start, begin, members, xy, is_fixed,
        np.ascontiguousarray(slopes), pull,
    )  # fmt: skip
    return coefficients, pull


@kernel
def _solved(  # type: ignore[no-untyped-def]
    cost, weight, counts, level, azimuth, slope, surface, wanted, start, begin, members, xy, is_fixed, slopes,
    pull
):  # fmt: skip
    """
    Return the coefficients, and add to each vertex' pull at each plane.

    Plane k is ``share[k] @ unknowns[number[k]]``.
    """
    number, share, n = _unknowns(level, azimuth, slope, surface)
    normal, target = np.zeros((n, n)), np.zeros(n)
    plane, owner, equation, factor, n_equations = _terms(begin, members, xy, is_fixed, slopes)
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
        moved = math.sqrt(max(_give(cost[k], factor[t]), 0.0) / counts[k])
        pull[owner[t], k] += moved * abs(force[equation[t]]) / weight[k]
    return coefficients


@inner_kernel
def _give(q, f):  # type: ignore[no-untyped-def]
    """Return fᵀ Q⁻¹ f of a symmetric matrix."""
    a, b, c = (
        q[1, 1] * q[2, 2] - q[1, 2] ** 2,
        q[0, 2] * q[1, 2] - q[0, 1] * q[2, 2],
        q[0, 1] * q[1, 2] - q[0, 2] * q[1, 1],
    )
    d, e, g = (
        q[0, 0] * q[2, 2] - q[0, 2] ** 2,
        q[0, 1] * q[0, 2] - q[0, 0] * q[1, 2],
        q[0, 0] * q[1, 1] - q[0, 1] ** 2,
    )
    x, y, z = a * f[0] + b * f[1] + c * f[2], b * f[0] + d * f[1] + e * f[2], c * f[0] + e * f[1] + g * f[2]
    return (f[0] * x + f[1] * y + f[2] * z) / (q[0, 0] * a + q[0, 1] * b + q[0, 2] * c)


@inner_kernel
def _unknowns(level, azimuth, slope, surface):  # type: ignore[no-untyped-def]
    """Number heights (shared or not), free gradients, slopes (shared or not): numbers, shares, how many."""
    n_planes = len(level)
    facing, free, every = (
        np.empty(n_planes, np.bool_),
        np.empty(n_planes, np.bool_),
        np.ones(n_planes, np.bool_),
    )
    number, share = np.zeros((n_planes, 3), np.int64), np.zeros((n_planes, 3, 3))
    for k in range(n_planes):
        facing[k] = not level[k] and not math.isnan(azimuth[k])
        free[k] = not level[k] and not facing[k]
    n = _number(surface, every, number[:, 2], 0, 1)
    n = _number(surface, free, number[:, 0], n, 2)
    n = _number(slope, facing, number[:, 0], n, 1)
    for k in range(n_planes):
        share[k, 2, 2] = 1.0
        if free[k]:
            number[k, 1] = number[k, 0] + 1
            share[k, 0, 0] = share[k, 1, 1] = 1.0
        elif facing[k]:
            share[k, 0, 0], share[k, 1, 0] = math.cos(azimuth[k]), math.sin(azimuth[k])
    return number, share, n


@inner_kernel
def _number(group, kept, number, first, step):  # type: ignore[no-untyped-def]
    """Number groups, then what is in none, from the first on in steps; return the next number."""
    at = np.full(len(group), -1, np.int64)
    for k in range(len(group)):
        if kept[k] and group[k] >= 0:
            at[group[k]] = 0
    for g in range(len(at)):
        if at[g] == 0:
            at[g] = first
            first += step
    for k in range(len(group)):
        if kept[k]:
            number[k] = at[group[k]] if group[k] >= 0 else first
            first += step if group[k] < 0 else 0
    return first


@inner_kernel
def _terms(begin, members, xy, is_fixed, slopes):  # type: ignore[no-untyped-def]
    """
    Return the terms of vertices' equations, sums of planes' coefficients times factors that are zero.

    At a given position all planes have the elevation of the first. Elsewhere the position is unknown, too:
    combinations of elevations in which it cancels out are zero, three fewer than there are planes. Returned
    are plane, vertex, equation and factors of each term, and the number of equations.
    """
    most = 0
    for v in range(len(is_fixed)):
        size = begin[v + 1] - begin[v]
        most += 2 * (size - 1) if is_fixed[v] else size * max(size - 3, 0)
    plane, owner, equation = np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most, np.int64)
    factor = np.empty((most, 3))
    n, n_equations = 0, 0
    for v in range(len(is_fixed)):
        first, size = begin[v], begin[v + 1] - begin[v]
        combinations = np.zeros((size, size))
        skipped = 1
        if is_fixed[v]:
            for k in range(1, size):
                combinations[0, k], combinations[k, k] = 1.0, -1.0
        else:
            skipped = 3
            _cancel_position(members[first : first + size], slopes, combinations)
        for column in range(skipped, size):
            for k in range(size):
                share = combinations[k, column]
                if is_fixed[v] and share == 0.0:
                    continue
                plane[n], owner[n], equation[n] = members[first + k], v, n_equations
                factor[n, 0], factor[n, 1], factor[n, 2] = share * xy[v, 0], share * xy[v, 1], share
                n += 1
            n_equations += 1
    return plane, owner, equation, factor, n_equations


@inner_kernel
def _cancel_position(members, slopes, q):  # type: ignore[no-untyped-def]
    """Write the orthogonal matrix whose columns from the fourth on are across all slopes and ones."""
    n = len(members)
    a, tau = np.ones((n, 3)), np.zeros(3)
    for k in range(n):
        q[k, k] = 1.0
        a[k, 0], a[k, 1] = slopes[members[k], 0], slopes[members[k], 1]
    # Reflections (Householder 1958) turn column after column onto its axis.
    for j in range(min(3, n - 1)):
        size = 0.0
        for k in range(j, n):
            size += a[k, j] ** 2
        if size == 0.0:
            continue
        turned = -math.copysign(math.sqrt(size), a[j, j])
        tau[j] = (turned - a[j, j]) / turned
        for k in range(j + 1, n):
            a[k, j] /= a[j, j] - turned
        a[j, j] = 1.0
        for column in range(j + 1, 3):
            _reflect(a, j, tau[j], a, column)
    for j in range(2, -1, -1):
        for column in range(n):
            _reflect(a, j, tau[j], q, column)


@inner_kernel
def _reflect(a, j, tau, other, column):  # type: ignore[no-untyped-def]
    """Reflect a column by the vector in column j from row j on."""
    along = 0.0
    for k in range(j, len(a)):
        along += a[k, j] * other[k, column]
    for k in range(j, len(a)):
        other[k, column] -= tau * along * a[k, j]
