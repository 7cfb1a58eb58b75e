"""
Model selection: planes are merged or dissolved wherever that describes the points more briefly.

A plane has a cost, and points cost the squares of their distances. Two planes stay two if the points gain
more by it than a plane costs (an energy of fit and number of models, Isack and Boykov 2012).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.few_rows import rows_by_group
from lidar_buildings.core.neighbours.union_find import root
from lidar_buildings.core.stages.plane_fitting.surroundings import Cloud
from lidar_buildings.core.surfaces.plane_geometry import distance_of, fitted_plane, residual_of
from lidar_buildings.core.surfaces.point_moments import N_MOMENTS, add_point

#: Pairs of planes that are remembered while pairs are listed.
_N_RECENT = 1021
#: Planes that are looked at around a point: more meet at no corner.
_MOST_AROUND = 4


@kernel
def seam_points(neighbours: NDArray[np.int32], labels: NDArray[np.int32]) -> IntArray:
    """Return the rows of the points that have neighbours in a plane, but not in their own."""
    rows = np.empty(len(labels), np.int64)
    n = 0
    for i in range(len(labels)):
        for j in neighbours[i]:
            if j < 0:
                break
            if labels[j] != labels[i] and labels[j] > 0:
                rows[n] = i
                n += 1
                break
    return rows[:n].copy()


def touching_planes(neighbours: NDArray[np.int32], labels: NDArray[np.int32], seam: IntArray) -> IntArray:
    """Return the pairs of planes, shape (n_pairs, 2), that have points in the neighbourhood of one point."""
    size = int(labels.max(initial=0)) + 1
    codes = np.unique(_pair_codes(neighbours, labels, seam, size))
    return np.column_stack([codes // size, codes % size])


@kernel
def _pair_codes(neighbours, labels, seam, size):  # type: ignore[no-untyped-def]
    """Return first × size + second of planes that meet around a point, the smaller number first."""
    codes = np.empty(6 * len(seam), np.int64)
    here = np.empty(_MOST_AROUND, np.int64)
    # Mostly the same pairs come again and again: recent ones are passed over.
    recent = np.full(_N_RECENT, -1, np.int64)
    n = 0
    for i in seam:
        found = _planes_around(neighbours, labels, i, here)
        for a in range(found):
            for b in range(a):
                code = min(here[a], here[b]) * size + max(here[a], here[b])
                if recent[code % _N_RECENT] != code:
                    recent[code % _N_RECENT] = codes[n] = code
                    n += 1
    return codes[:n]


@kernel
def _planes_around(neighbours: NDArray[np.int32], labels: NDArray[np.int32], i: int, here: IntArray) -> int:
    """Write the planes of a point and its neighbours to `here`, the first few; return how many."""
    n, last = 0, 0
    if labels[i] > 0:
        here[0], last = labels[i], labels[i]
        n = 1
    for j in neighbours[i]:
        if j < 0 or n == len(here):
            break
        if labels[j] == last or labels[j] == 0:
            continue
        last = labels[j]
        is_new = True
        for k in range(n):
            is_new &= here[k] != last
        if is_new:
            here[n] = last
            n += 1
    return n


# Those with which `bench.planes.run` finds all planes of the roofs labelled by hand and none too many.
#: Cost of a plane against half the squared distances of points in parts of their variance.
_PLANE_COST = 20.0
#: By how much roofs swell and sag without being two planes [m].
_UNEVENNESS = 0.05
#: Points nearer to one another than this err alike and count as one [m].
_CORRELATION_LENGTH = 0.4


class Prices(NamedTuple):
    """What describing points costs."""

    #: Cost of a plane, in natural units of information.
    plane: float
    #: Cost of a point, per squared metre of its distance from its plane.
    point: float
    #: Cost that each point of a plane adds to the cost of the plane: real roofs are not quite plane.
    unevenness: float
    #: Largest distance of a point from its plane [m].
    distance: float


def prices_of(distance: float, noise: float, spacing: float) -> Prices:
    """Return a cloud's prices by the largest distance from a plane, the noise and the point spacing [m]."""
    deviation = max(noise, distance / 3.0)
    weight = min(1.0, (spacing / _CORRELATION_LENGTH) ** 2)
    point = weight / (2.0 * deviation**2)
    return Prices(_PLANE_COST, point, point * _UNEVENNESS**2, distance)


def select_planes(
    cloud: Cloud, labels: NDArray[np.int32], seam: IntArray, prices: Prices
) -> NDArray[np.int32]:
    """
    Join neighbouring planes, the best pair first, and give up planes, the smallest first, where that saves.

    A plane is given up if its points lie nearly as well on the planes around. `seam` are the rows of points
    that have neighbours in another plane.
    """
    size = int(labels.max(initial=0)) + 1
    touching = touching_planes(cloud.neighbours, labels, seam)
    moments = plane_sums(cloud.points, labels, size)
    parent = _merged(moments, touching.copy(), prices, np.arange(size))
    labels = parent[labels].astype(np.int32)
    first, beside = _neighbours_of_planes(parent[touching], size)
    rows, begin = rows_by_group(labels.astype(np.int64), size)
    moments = plane_sums(cloud.points, labels, size)
    by_size = np.argsort(moments[:, 0], kind="stable")
    return _dissolved(cloud.points, labels, moments, by_size, first, beside, rows, begin, prices)


def _neighbours_of_planes(pairs: IntArray, size: int) -> tuple[IntArray, IntArray]:
    """Return the planes beside each: those of plane k are ``beside[first[k]:first[k + 1]]``."""
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    both = np.unique(np.concatenate([pairs, pairs[:, ::-1]]) @ np.array([size, 1]))
    first = np.searchsorted(both // size, np.arange(size + 1))
    return first, both % size


@kernel
def plane_sums(points: FloatArray, labels: NDArray[np.int32], size: int) -> FloatArray:
    """Return the sums of every plane's points by its number."""
    moments = np.zeros((size, N_MOMENTS))
    for i in range(len(labels)):
        if labels[i] > 0:
            add_point(moments[labels[i]], points[i, 0], points[i, 1], points[i, 2])
    return moments


@kernel
def equations_of(moments: FloatArray) -> FloatArray:
    """Return a, b, c, d of every plane's least-squares plane; zeros where it has no points."""
    equations = np.zeros((len(moments), 4))
    for k in range(1, len(moments)):
        fitted_plane(moments[k], equations[k])
    return equations


@kernel
def _saving(moments: FloatArray, a: int, b: int, prices: Prices) -> float:
    joint = np.empty(N_MOMENTS)
    for k in range(N_MOMENTS):
        joint[k] = moments[a, k] + moments[b, k]
    loss = residual_of(joint) - residual_of(moments[a]) - residual_of(moments[b])
    fewer = min(moments[a, 0], moments[b, 0])
    return prices.plane + prices.unevenness * fewer - prices.point * loss


@kernel
def _merged(moments: FloatArray, pairs: IntArray, prices: Prices, parent: IntArray) -> IntArray:
    saving = np.empty(len(pairs))
    for k in range(len(pairs)):
        saving[k] = _saving(moments, pairs[k, 0], pairs[k, 1], prices)
    while len(pairs):
        best = 0
        for k in range(len(pairs)):
            if saving[k] > saving[best]:
                best = k
        if saving[best] <= 0.0:
            break
        a, b = min(pairs[best, 0], pairs[best, 1]), max(pairs[best, 0], pairs[best, 1])
        for k in range(N_MOMENTS):
            moments[a, k] += moments[b, k]
        parent[b] = a
        for k in range(len(pairs)):
            for side in range(2):
                if pairs[k, side] == b:
                    pairs[k, side] = a
            if pairs[k, 0] == pairs[k, 1]:
                saving[k] = -math.inf
            elif pairs[k, 0] == a or pairs[k, 1] == a:
                saving[k] = _saving(moments, pairs[k, 0], pairs[k, 1], prices)
    for k in range(len(parent)):
        parent[k] = root(parent, k)
    return parent


@kernel
def _dissolved(points, labels, moments, by_size, first, beside, rows, begin, prices):  # type: ignore[no-untyped-def]
    """Return the labels without the planes that do not pay; see `select_planes`."""
    labels = labels.copy()
    equations = equations_of(moments)
    alive = np.zeros(len(moments), dtype=np.bool_)
    for a in by_size:
        alive[a] = moments[a, 0] > 0.0
    for a in by_size:
        if a == 0 or not alive[a] or first[a] == first[a + 1]:
            continue
        loss, n = 0.0, begin[a + 1] - begin[a]
        for i in rows[begin[a] : begin[a + 1]]:
            best = prices.distance
            for b in beside[first[a] : first[a + 1]]:
                if alive[b]:
                    best = min(best, distance_of(equations[b], points, i))
            own = min(prices.distance, distance_of(equations[a], points, i))
            loss += best**2 - own**2
        if prices.point * loss >= prices.plane + prices.unevenness * n:
            continue
        alive[a] = False
        for i in rows[begin[a] : begin[a + 1]]:
            best, taken = prices.distance, 0
            for b in beside[first[a] : first[a + 1]]:
                if alive[b] and distance_of(equations[b], points, i) < best:
                    best, taken = distance_of(equations[b], points, i), b
            labels[i] = taken
    return labels
