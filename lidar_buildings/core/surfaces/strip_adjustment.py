"""Flight strips brought together where they overlap: heights, and the plan where sloping roofs tell it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from lidar_buildings.core.neighbours.cell_grid import cell_numbers
from lidar_buildings.core.surfaces.alignment import N_NEAR, planes_at, tukey_weights

_Floats = NDArray[np.float64]
_Pairs = frozenset[tuple[int, int]]

#: Side of the blocks in which strips are compared [m], the fewest points of each of two strips in one, and
#: the most points of a strip that are compared.
BLOCK, _MIN_POINTS, _MOST_POINTS = 20.0, 50, 300_000
#: Vertical part of the normals of level planes at least, and of sloping ones at least: 14 and 72 degrees.
_LEVEL, _STEEPEST = 0.97, 0.3
#: Normals of planes that are the same differ by at most so much: 10 degrees.
_ALIKE = math.cos(math.radians(10.0))
#: Distances within which planes of two strips are compared, round by round [m].
_REACHES = (3.0, 3.0, 2.0, 1.5, 1.0, 1.0, 1.0)
#: The fewest pairs of planes that two strips are compared by.
MIN_PAIRS = 100
#: Standard error up to which two strips' shift in plan counts as told: then twice it is 5 cm [m]; and the
#: least standard deviation of a distance between planes [m].
_MAX_ERROR, _LEAST_SIGMA = 0.025, 0.02
#: Standard deviation of shifts in plan that nothing tells [m].
_PLAN_SIGMA = 1.0


class Residuals(NamedTuple):
    """How far the planes that two strips have in common lie apart."""

    n_level: int  #: pairs of level planes
    height: float  #: median of the second strip's height above the first there [m]
    rms_level: float  #: [m]; NaN where there is no pair
    n_sloping: int  #: pairs of sloping planes, of roofs mostly
    rms_sloping: float  #: of distances along the normal [m]; NaN where there is no pair


class StripPair(NamedTuple):
    """Two strips that overlap."""

    first: int
    second: int
    before: Residuals
    after: Residuals


@dataclass(frozen=True, eq=False)
class StripAdjustment:
    """What is added to strips; strips that overlap no other stay where they are."""

    strips: NDArray[np.int64]  #: their numbers, rising, shape (n_strips,)
    #: x, y, z [m]; strips that are connected stay on average where they are, shape (n_strips, 3).
    shift: _Floats
    #: Standard errors in plan and height [m]; infinite where nothing tells it, which then is 0, shape
    #: (n_strips, 2).
    error: _Floats
    pairs: tuple[StripPair, ...]


class _Planes(NamedTuple):
    places: _Floats
    normals: _Floats  # upwards


def adjust_strips(points: _Floats, strip: NDArray[np.integer]) -> StripAdjustment:
    """
    Find by how much strips have to be shifted so that the surfaces that they have in common coincide.

    Planes through neighbouring points of one strip are compared with those of another near by that have the
    same normal; all shifts are found together, by least squares of the distances along the normals (Kager
    2004), round by round, weighed by Tukey's biweight. Level planes tell heights; two strips whose sloping
    planes tell the plan to `_MAX_ERROR` are laid on each other in plan, too. Strips neither turn nor bend.
    `points` have shape (n, 3) [m], `strip` is the flight strip of each.
    """
    numbers, of = np.unique(np.asarray(strip, dtype=np.int64), return_inverse=True)
    planes = _planes_of_strips(points, of.ravel(), len(numbers))
    touching = _pairs_of(planes)
    shift, error, telling = _solved(planes, touching, frozenset(touching))
    if telling != frozenset(touching):
        shift, error, _ = _solved(planes, touching, telling)
    pairs = []
    for i, j in touching:
        before, after = (_residuals(planes[i], planes[j], by) for by in (np.zeros(3), shift[j] - shift[i]))
        if max(before.n_level, after.n_level) + max(before.n_sloping, after.n_sloping) >= MIN_PAIRS:
            pairs.append(StripPair(int(numbers[i]), int(numbers[j]), before, after))
    return StripAdjustment(numbers, shift, error, tuple(pairs))


def _planes_of_strips(points: _Floats, strip: NDArray[np.intp], n_strips: int) -> list[_Planes]:
    """Return each strip's planes in blocks that another one has points in, too."""
    blocks = np.unique(cell_numbers(points, BLOCK), return_inverse=True)[1].ravel()
    both, n = np.unique(blocks * n_strips + strip, return_counts=True)
    full = both[n >= _MIN_POINTS]
    shared = np.bincount(full // n_strips, minlength=int(blocks.max(initial=0)) + 1) >= 2
    found = []
    for own in range(n_strips):
        rows = np.flatnonzero((strip == own) & shared[blocks])
        # spread over the whole overlap: every so many blocks, in an order that has no direction
        turns = (blocks[rows] * 0.6180339887498949) % 1.0
        rows = rows[turns <= _MOST_POINTS / max(len(rows), 1)]
        if len(rows) < N_NEAR:
            found.append(_Planes(np.empty((0, 3)), np.empty((0, 3))))
            continue
        places, normals = planes_at(points.take(rows, axis=0))
        normals = normals * np.where(normals[:, 2:] < 0.0, -1.0, 1.0)
        steep = normals[:, 2] < _STEEPEST
        found.append(_Planes(places[~steep], normals[~steep]))
    return found


def _pairs_of(planes: list[_Planes]) -> list[tuple[int, int]]:
    filled = [k for k, one in enumerate(planes) if len(one.places)]
    return [(i, j) for k, i in enumerate(filled) for j in filled[k + 1 :] if _touch(planes[i], planes[j])]


def _touch(one: _Planes, other: _Planes) -> bool:
    low = np.maximum(one.places.min(axis=0), other.places.min(axis=0))[:2]
    high = np.minimum(one.places.max(axis=0), other.places.max(axis=0))[:2]
    return bool((low <= high + _REACHES[0]).all())


def _compared(one: _Planes, other: _Planes, by: _Floats, reach: float) -> tuple[_Floats, _Floats]:
    """Return common normals and distances of planes of the second strip, shifted, above the first's [m]."""
    places = other.places + by
    distance, near = cKDTree(one.places).query(places, distance_upper_bound=reach)
    rows = np.flatnonzero(np.isfinite(distance))
    near = near[rows]
    alike = (one.normals[near] * other.normals[rows]).sum(axis=1) >= _ALIKE
    rows, near = rows[alike], near[alike]
    normal = one.normals[near] + other.normals[rows]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return normal, ((places[rows] - one.places[near]) * normal).sum(axis=1)


def _solved(
    planes: list[_Planes], pairs: list[tuple[int, int]], telling: _Pairs
) -> tuple[_Floats, _Floats, _Pairs]:
    """
    Return shifts, 0 where nothing tells them, and standard errors in plan and height.

    Of the pairs `telling` may tell the plan, too; last, those that do as it turns out are returned.
    """
    n, axes = len(planes), (slice(0, 2), slice(2, 3))
    shift, error = np.zeros((n, 3)), np.full((n, 2), np.inf)
    told: set[tuple[int, int]] = set()
    for reach in _REACHES:
        told.clear()
        matrix, right = np.zeros((n, 3, n, 3)), np.zeros((n, 3))
        linked = np.zeros((2, n, n), dtype=bool)  # in plan, and in height
        square, weights = 0.0, 0.0
        for i, j in pairs:
            normal, off = _compared(planes[i], planes[j], shift[j] - shift[i], reach)
            if len(off) < MIN_PAIRS:
                continue
            weight = _weights(normal, off)
            variance = max(float(np.average(off**2, weights=weight)), _LEAST_SIGMA**2)
            if _plan_error(normal, weight, variance) <= _MAX_ERROR:
                told.add((i, j))
            # distances are long before the last rounds, and the error is not yet known
            tells = (i, j) in telling and _plan_error(normal, weight, _LEAST_SIGMA**2) <= _MAX_ERROR
            square, weights = square + variance * float(weight.sum()), weights + float(weight.sum())
            part = (normal * weight[:, None]).T @ normal
            pull = (normal * weight[:, None]).T @ off
            if not tells:
                part, pull = _height_alone(part, pull, variance)
            for a, b in ((i, j), (j, i)):
                matrix[a, :, a] += part
                matrix[a, :, b] -= part
            right[i] += pull
            right[j] -= pull
            linked[:, i, j] = tells, True
        error[:] = np.inf
        free = np.zeros((n, 3), dtype=bool)
        for kind, own in enumerate(axes):
            number, group = connected_components(linked[kind], directed=False)
            connected = np.bincount(group, minlength=number)[group] > 1
            free[connected, own] = True
            # strips that are connected stay on average where they are
            for one in np.unique(group[connected]):
                rows = np.flatnonzero(group == one)
                for axis in range(3)[own]:
                    block = np.ix_(rows, np.array([axis]), rows, np.array([axis]))
                    matrix[block] += matrix[rows, axis, rows, axis].mean()
        if not free.any():
            break
        at = np.flatnonzero(free.ravel())
        inverse = np.linalg.inv(matrix.reshape(3 * n, 3 * n)[np.ix_(at, at)])
        shift.ravel()[at] += inverse @ right.ravel()[at]
        # neighbouring planes share points: of N_NEAR one is independent
        variances = np.full(3 * n, np.inf)
        variances[at] = np.diag(inverse) * square / weights * N_NEAR
        for kind, own in enumerate(axes):
            error[:, kind] = np.sqrt(variances.reshape(n, 3)[:, own].max(axis=1))
    shift[np.isinf(error[:, 0]), :2] = 0.0
    shift[np.isinf(error[:, 1])] = 0.0
    return shift, error, frozenset(told)


def _height_alone(part: _Floats, pull: _Floats, variance: float) -> tuple[_Floats, _Floats]:
    """Return what normal equations tell of the height whatever the plan is, about `_PLAN_SIGMA` at most."""
    slopes = np.linalg.solve(part[:2, :2] + np.eye(2) * variance / _PLAN_SIGMA**2, part[:2, 2])
    height, lifted = np.zeros((3, 3)), np.zeros(3)
    height[2, 2] = part[2, 2] - part[2, :2] @ slopes
    lifted[2] = pull[2] - pull[:2] @ slopes
    return height, lifted


def _weights(normal: _Floats, off: _Floats) -> _Floats:
    """Return weights of distances, of level planes and of sloping ones each among themselves."""
    weight, is_level = np.zeros(len(off)), normal[:, 2] >= _LEVEL
    for kind in (is_level, ~is_level):
        weight[kind] = tukey_weights(off[kind])
    return weight


def _plan_error(normal: _Floats, weight: _Floats, variance: float) -> float:
    """Return the standard error of the shift in plan between two strips, in its worst direction [m]."""
    part = (normal * weight[:, None]).T @ normal
    plan = part[:2, :2] - np.outer(part[:2, 2], part[2, :2]) / part[2, 2]
    least = float(np.linalg.eigvalsh(plan)[0])
    return math.sqrt(variance * N_NEAR / least) if least > 0.0 else math.inf


def _residuals(one: _Planes, other: _Planes, by: _Floats) -> Residuals:
    normal, off = _compared(one, other, by, _REACHES[-1])
    is_level = normal[:, 2] >= _LEVEL
    level, sloping = off[is_level], off[~is_level]
    height = float(np.median(level / normal[is_level, 2])) if len(level) else math.nan
    return Residuals(len(level), height, _rms(level), len(sloping), _rms(sloping))


def _rms(off: _Floats) -> float:
    """Return the root mean square of what is no outlier."""
    used = off[tukey_weights(off - np.median(off)) > 0.0] if len(off) else off
    return float(np.sqrt(np.mean(used**2))) if len(used) else math.nan
