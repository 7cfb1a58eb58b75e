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
#: Cosine of the angle between planes beyond which they are not one: 10°.
_ALIKE = 0.985
#: Planes that are farther from the middle of the other's seams are not one [largest distances of points].
_OFF = 3.0


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


def bridged_planes(
    cloud: Cloud,
    labels: NDArray[np.int32],
    seam: IntArray,
    equations: FloatArray,
    bridge: float,
    max_distance: float,
) -> IntArray:
    """
    Return the pairs of planes, shape (n_pairs, 2), that may be one that another comes between.

    A bridge, no longer than that, leads from the one to the other over points that lie within `max_distance`
    of the plane, though they belong to others: such as there are where two valleys end at a ridge. `seam` are
    the rows of points that have neighbours in another plane; `equations` hold a, b, c, d of each plane by its
    number.
    """
    rows, first = rows_by_group(labels[seam].astype(np.int64), len(equations))
    is_bridged = np.zeros((len(equations), len(equations)), dtype=bool)
    _bridge(cloud, labels, seam[rows], first, equations, bridge, max_distance, is_bridged)
    return np.argwhere(is_bridged)


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


@kernel
def _bridge(cloud, labels, rows, first, equations, bridge, max_distance, is_bridged):  # type: ignore[no-untyped-def]
    """Compare all planes that have seams; see `bridged_planes`."""
    points = cloud.points
    way = np.full(len(points), np.inf)
    queue = np.empty(len(points), np.int64)
    size = len(equations)
    low, high = np.full((size, 3), np.inf), np.full((size, 3), -np.inf)
    middle = np.zeros((size, 3))
    for k in range(1, size):
        for i in rows[first[k] : first[k + 1]]:
            for axis in range(3):
                middle[k, axis] += points[i, axis] / (first[k + 1] - first[k])
                low[k, axis] = min(low[k, axis], points[i, axis])
                high[k, axis] = max(high[k, axis], points[i, axis])
    for a in range(1, size):
        for b in range(a + 1, size):
            apart = False
            for axis in range(3):
                apart |= low[a, axis] > high[b, axis] + bridge or low[b, axis] > high[a, axis] + bridge
            if apart or not _alike(equations, middle, a, b, _OFF * max_distance):
                continue
            one, other = rows[first[a] : first[a + 1]], rows[first[b] : first[b + 1]]
            is_bridged[a, b] = _leads_to(
                cloud, labels, one, b, equations[a], bridge, max_distance, way, queue
            ) or _leads_to(cloud, labels, other, a, equations[b], bridge, max_distance, way, queue)


@kernel
def _alike(equations, middle, a, b, max_offset):  # type: ignore[no-untyped-def]
    """Whether planes are nearly parallel, each nearly through the middle of the other's seams."""
    cosine = 0.0
    for axis in range(3):
        cosine += equations[a, axis] * equations[b, axis]
    return (
        abs(cosine) >= _ALIKE
        and distance_of(equations[a], middle, b) <= max_offset
        and distance_of(equations[b], middle, a) <= max_offset
    )


@kernel
def _leads_to(cloud, labels, start, goal, plane, bridge, max_distance, way, queue):  # type: ignore[no-untyped-def]
    """Whether a bridge leads from points over others on their plane to `goal`; `way` is infinite."""
    own = labels[start[0]] if len(start) else 0
    tail, head, found = 0, 0, False
    for i in start:
        if distance_of(plane, cloud.points, i) <= max_distance:
            way[i], queue[tail] = 0.0, i
            tail += 1
    while head < tail and not found:
        i = queue[head]
        head += 1
        for near in cloud.neighbours[i]:
            j = np.int64(near)
            if j < 0:
                break
            if labels[j] == own or way[j] < np.inf or distance_of(plane, cloud.points, j) > max_distance:
                continue
            dx = cloud.points[j, 0] - cloud.points[i, 0]
            dy = cloud.points[j, 1] - cloud.points[i, 1]
            dz = cloud.points[j, 2] - cloud.points[i, 2]
            length = way[i] + np.sqrt(dx * dx + dy * dy + dz * dz)
            if length <= bridge:
                found |= labels[j] == goal
                way[j], queue[tail] = length, j
                tail += 1
    for k in range(tail):
        way[queue[k]] = np.inf
    return found


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
    cloud: Cloud, labels: NDArray[np.int32], seam: IntArray, prices: Prices, bridge: float
) -> NDArray[np.int32]:
    """
    Join neighbouring planes, the best pair first, and give up planes, the smallest first, where that saves.

    A plane is given up if its points lie nearly as well on the planes around. `seam` are the rows of points
    that have neighbours in another plane; parts of a plane as near to one another as `bridge` [m] may be
    joined even where another plane comes between.
    """
    size = int(labels.max(initial=0)) + 1
    touching = touching_planes(cloud.neighbours, labels, seam)
    moments = plane_sums(cloud.points, labels, size)
    bridged = bridged_planes(cloud, labels, seam, equations_of(moments), bridge, prices.distance)
    parent = _merged(moments, np.concatenate([touching, bridged]), prices, np.arange(size))
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
