"""Where planes meet: points move to the plane that fits them best, beside neighbours of the same plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.stages.plane_fitting.model_selection import equations_of, plane_sums
from lidar_buildings.core.stages.plane_fitting.surroundings import MAX_NEIGHBOURS, Cloud
from lidar_buildings.core.surfaces.plane_geometry import distance_of

#: Times that planes are fitted anew to their points, and rounds of moves with the same planes.
_MAX_FITS, _MAX_ROUNDS = 2, 4


@kernel
def refine_labels(
    cloud: Cloud, labels: NDArray[np.int32], seam: IntArray, max_distance: float, smoothness: float
) -> NDArray[np.int32]:
    """
    Let every point on a seam choose among the planes around it, until none moves.

    The first plane extracted takes a strip of its neighbours where they meet; here these points go to the
    plane that they are nearest to, and points that no plane took (label 0) join the one beside them. Each
    move lowers Σ (distance / largest distance)² − smoothness × share of neighbours in the same plane
    (iterated conditional modes, Besag 1986). `seam` are the rows of points that have neighbours in another
    plane: others stay where they are.
    """
    labels = labels.copy()
    size = 1
    for label in labels:
        size = max(size, label + 1)
    waiting = np.zeros(len(labels), np.bool_)
    for i in seam:
        waiting[i] = True
    for _ in range(_MAX_FITS):
        equations = equations_of(plane_sums(cloud.points, labels, size))
        moved = move_points(cloud, labels, equations, max_distance, smoothness, waiting)
        if moved <= len(labels) // 1000:
            break
    return labels


@kernel
def move_points(
    cloud: Cloud,
    labels: NDArray[np.int32],
    equations: FloatArray,
    max_distance: float,
    smoothness: float,
    waiting: BoolArray,
) -> int:
    """
    Move points to other planes where that costs less; return how many moved.

    Only points that are `waiting` are looked at; those by a seam wait again for the planes' next fit.
    """
    number, count = np.empty(MAX_NEIGHBOURS + 1, np.int32), np.empty(MAX_NEIGHBOURS + 1, np.int64)
    by_seam = np.zeros(len(labels), np.bool_)
    moved = 0
    for _ in range(_MAX_ROUNDS):
        before = moved
        for i in range(len(labels)):
            if not waiting[i]:
                continue
            waiting[i] = False
            n = labels_around(cloud.neighbours[i], labels, labels[i], number, count)
            if n == 1 and labels[i] == 0:
                continue
            best = cheapest(cloud.points, i, number, count, n, equations, max_distance, smoothness)
            by_seam[i] = n > 2 or (n == 2 and number[1] > 0) or best != labels[i]
            if best != labels[i]:
                labels[i] = best
                moved += 1
                for j in cloud.neighbours[i]:
                    if j < 0:
                        break
                    waiting[j] = True
        if moved == before:
            break
    for i in range(len(labels)):
        waiting[i] |= by_seam[i]
    return moved


@kernel
def labels_around(
    neighbours: NDArray[np.int32],
    labels: NDArray[np.int32],
    own: int,
    number: NDArray[np.int32],
    count: IntArray,
) -> int:
    """
    Write the planes around a point to `number`, and to `count` how many neighbours have each.

    The first place is that of the point's own label, 0 included. Returns how many there are.
    """
    number[0], count[0] = own, 0
    n, last = 1, 0
    for j in neighbours:
        if j < 0:
            break
        if labels[j] != number[last]:
            last = 0
            while last < n and number[last] != labels[j]:
                last += 1
            if last == n:
                number[n], count[n] = labels[j], 0
                n += 1
        count[last] += 1
    return n


@kernel
def cheapest(
    points: FloatArray,
    i: int,
    number: NDArray[np.int32],
    count: IntArray,
    n: int,
    equations: FloatArray,
    max_distance: float,
    smoothness: float,
) -> int:
    """Return the plane of least cost within reach of point i, 0 if there is none."""
    total = 0
    for k in range(n):
        total += count[k]
    best, chosen = np.inf, 0
    for k in range(n):
        if number[k] == 0:
            continue
        off = distance_of(equations[number[k]], points, i) / max_distance
        if off > 1.0:
            continue
        cost = off * off - smoothness * count[k] / max(total, 1)
        if cost < best:
            best, chosen = cost, number[k]
    return chosen
