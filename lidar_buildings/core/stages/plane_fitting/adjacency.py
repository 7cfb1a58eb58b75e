"""Which planes are near each other: where they meet, and across what lies between parts of one plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.few_rows import rows_by_group
from lidar_buildings.core.stages.plane_fitting.surroundings import Cloud
from lidar_buildings.core.surfaces.plane_geometry import distance_of

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
def _pair_codes(
    neighbours: NDArray[np.int32], labels: NDArray[np.int32], seam: IntArray, size: int
) -> IntArray:
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
    """
    Whether two planes are nearly parallel, and each goes nearly through the middle of the other's seams.
    """
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
    """
    Whether a bridge leads from the starting points over others on their plane to the plane numbered `goal`.

    `way` is infinite throughout, before and after, and `queue` is room for as many points as there are.
    """
    own = labels[start[0]] if len(start) else 0
    tail, head, found = 0, 0, False
    for i in start:
        if distance_of(plane, cloud.points, i) <= max_distance:
            way[i], queue[tail] = 0.0, i
            tail += 1
    while head < tail and not found:
        i = queue[head]
        head += 1
        for j in cloud.neighbours[i]:
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
