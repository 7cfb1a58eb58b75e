"""Joint least squares of planes under relations and with common vertices."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
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
    terms = _equations(planes, vertices, slopes)
    pull = np.zeros((len(vertices), len(weight)))
    coefficients = _solved(
        planes.cost, weight, planes.counts, *relations, wanted, start, *terms, pull
    )  # fmt: skip
    return coefficients, pull


@kernel
def _solved(  # type: ignore[no-untyped-def]
    cost, weight, counts, level, azimuth, slope, surface, wanted, start, equation, plane, factor, owner, pull
):  # fmt: skip
    """
    Return the coefficients, and add to each vertex' pull at each plane.

    Plane k is ``share[k] @ unknowns[number[k]]``.
    """
    number, share, n = _unknowns(level, azimuth, slope, surface)
    normal, target = np.zeros((n, n)), np.zeros(n)
    rows, values = np.zeros((len(owner), n)), np.zeros(len(owner))
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
        pull[owner[equation[t]], k] += moved * abs(force[equation[t]]) / weight[k]
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


class _Terms(NamedTuple):
    """
    The equations of vertices, each a sum of planes' coefficients times factors that is zero.

    Attributes
    ----------
    equation, plane : ndarray of shape (n_terms,), int64
        Rows of the equation and the plane.
    factor : ndarray of shape (n_terms, 3)
        Of a, b, c.
    owner : ndarray of shape (n_equations,), int64
        The vertex that each equation belongs to.
    """

    equation: IntArray
    plane: IntArray
    factor: FloatArray
    owner: IntArray


_NO_TERMS = _Terms(*(np.zeros(0, np.int64),) * 2, np.zeros((0, 3)), np.zeros(0, np.int64))


def _equations(planes: FreePlanes, vertices: Sequence[CommonVertex], slopes: FloatArray) -> _Terms:
    """
    Return the equations of vertices.

    At a given position all planes have the elevation of the first. Elsewhere the position is unknown, too:
    combinations of elevations in which it cancels out are zero, three fewer than there are planes.
    """
    if not len(vertices):
        return _NO_TERMS
    terms: list[tuple[int, int, float, float, float]] = []
    owner: list[int] = []
    for number, vertex in enumerate(vertices):
        if vertex.fixed:
            first, *others = vertex.planes
            for k in others:
                terms += [(len(owner), first - 1, 1.0, *vertex.xy), (len(owner), k - 1, -1.0, *vertex.xy)]
                owner.append(number)
            continue
        members = np.array(vertex.planes) - 1
        position = np.column_stack([slopes[members], np.ones(len(members))])
        for combination in np.linalg.qr(position, mode="complete")[0][:, 3:].T.tolist():
            terms += [
                (len(owner), k, w, *vertex.xy) for k, w in zip(members.tolist(), combination, strict=True)
            ]
            owner.append(number)
    table = np.array(terms, dtype=np.float64).reshape(-1, 5)
    xy = table[:, 3:] - planes.moments.centre[:2]
    factor = table[:, 2:3] * np.column_stack([xy, np.ones(len(xy))])
    equation, plane = table[:, :2].astype(np.int64).T
    return _Terms(equation, plane, factor, np.array(owner, dtype=np.int64))
