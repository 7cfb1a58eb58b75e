"""Joint least squares of planes under relations and with common vertices."""

from __future__ import annotations

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
    n_planes = len(relations.level)
    facing = np.isfinite(relations.azimuth) & ~relations.level
    free = ~facing & ~relations.level
    number = np.zeros((n_planes, 3), dtype=np.int64)
    share = np.zeros((n_planes, 3, 3))
    number[:, 2], n_heights = _numbered(relations.surface, np.ones(n_planes, dtype=np.bool_))
    gradients, n_gradients = _numbered(relations.surface, free)
    number[free, 0] = n_heights + 2 * gradients[free]
    number[free, 1] = number[free, 0] + 1
    first_slope = n_heights + 2 * n_gradients
    slopes, n_slopes = _numbered(relations.slope, facing)
    number[facing, 0] = first_slope + slopes[facing]
    share[facing, 0, 0] = np.cos(relations.azimuth[facing])
    share[facing, 1, 0] = np.sin(relations.azimuth[facing])
    share[free, 0, 0] = share[free, 1, 1] = 1.0
    share[:, 2, 2] = 1.0
    return Unknowns(number, share, first_slope + n_slopes)


def _numbered(group: IntArray, kept: BoolArray) -> tuple[IntArray, int]:
    """Number groups and what is in none from 0; return each one's number and how many there are."""
    own = np.where(group >= 0, group, group.max(initial=-1) + 1 + np.arange(len(group)))
    distinct, inverse = np.unique(own[kept], return_inverse=True)
    number = np.zeros(len(group), dtype=np.int64)
    number[kept] = inverse
    return number, len(distinct)


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
    terms = _equations(planes, vertices, slopes)
    normal, target = np.zeros((unknowns.n, unknowns.n)), np.zeros(unknowns.n)
    rows, values = np.zeros((len(terms.owner), unknowns.n)), np.zeros(len(terms.owner))
    _assemble(planes.cost, weight, unknowns, wanted, start, terms, normal, target, rows, values)
    solution, force = constrained_minimum(normal, target, rows, values)
    coefficients = start + np.einsum("kij,kj->ki", unknowns.share, solution[unknowns.number])
    if not len(vertices):
        return coefficients, np.zeros((0, len(weight)))
    return coefficients, _pulls(planes, weight, terms, force, len(vertices))


@kernel
def _assemble(cost, weight, unknowns, wanted, start, terms, normal, target, rows, values):  # type: ignore[no-untyped-def]
    """Add the normal equations and their right sides, and the rows of the constraints and their values."""
    number, share = unknowns.number, unknowns.share
    for k in range(len(cost)):
        for j in range(3):
            for m in range(3):
                moved = 0.0
                for i in range(3):
                    moved += cost[k, m, i] * weight[k] * share[k, i, j]
                target[number[k, j]] += moved * wanted[k, m]
                for i in range(3):
                    normal[number[k, i], number[k, j]] += share[k, m, i] * moved
    for k in range(len(target)):
        normal[k, k] += 1e-9 * (1.0 + normal[k, k])
    for t in range(len(terms.plane)):
        k, equation = terms.plane[t], terms.equation[t]
        for i in range(3):
            values[equation] -= terms.factor[t, i] * start[k, i]
            for j in range(3):
                rows[equation, number[k, j]] += terms.factor[t, i] * share[k, i, j]


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


def _equations(planes: FreePlanes, vertices: Sequence[CommonVertex], slopes: FloatArray) -> _Terms:
    """
    Return the equations of vertices.

    At a given position all planes have the elevation of the first. Elsewhere the position is unknown, too:
    combinations of elevations in which it cancels out are zero, three fewer than there are planes.
    """
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


def _pulls(
    planes: FreePlanes, weight: FloatArray, terms: _Terms, force: FloatArray, n_vertices: int
) -> FloatArray:
    """
    Return by how much the multipliers of each vertex's equations would move each plane if it were free [m].
    """
    pull = np.zeros((n_vertices, len(weight)))
    plane, pushed = terms.plane, terms.factor
    give = np.linalg.inv(planes.cost)[plane]
    moved = np.sqrt(np.maximum(np.einsum("ri,rij,rj->r", pushed, give, pushed), 0.0) / planes.counts[plane])
    moves = moved * np.abs(force[terms.equation]) / weight[plane]
    np.add.at(pull, (terms.owner[terms.equation], plane), moves)
    return pull
