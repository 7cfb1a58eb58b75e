"""Connected planes: extraction, model selection, label refinement, and connected parts."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.union_find import flatten, link
from lidar_buildings.core.stages.plane_fitting.config import PlaneFittingConfig
from lidar_buildings.core.stages.plane_fitting.model_selection import (
    equations_of,
    plane_sums,
    prices_of,
    seam_points,
    select_planes,
)
from lidar_buildings.core.stages.plane_fitting.search import PROBABILITY, Limits, extract, samples_needed
from lidar_buildings.core.stages.plane_fitting.surroundings import MAX_NEIGHBOURS, Cloud, survey_points
from lidar_buildings.core.surfaces.plane_geometry import distance_of

#: Times that planes are fitted anew to their points, and rounds of moves with the same planes.
_MAX_FITS, _MAX_ROUNDS = 2, 4


@kernel
def refine_labels(cloud, labels, seam, max_distance, smoothness):  # type: ignore[no-untyped-def]
    """
    Let every point on a seam choose among the planes around it, until none moves.

    The first plane extracted takes a strip of its neighbours where they meet; here these points go to the
    plane that they are nearest to, and points that no plane took (label 0) join the one beside them. Each
    move lowers Σ (distance / largest distance)² − smoothness × share of neighbours in the same plane
    (iterated conditional modes, Besag 1986). `seam` are the rows of points that have neighbours in another
    plane: others stay where they are.
    """
    labels = labels.copy()
    size = np.int64(1)
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
def move_points(cloud, labels, equations, max_distance, smoothness, waiting):  # type: ignore[no-untyped-def]
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
def labels_around(neighbours, labels, own, number, count):  # type: ignore[no-untyped-def]
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
def cheapest(points, i, number, count, n, equations, max_distance, smoothness):  # type: ignore[no-untyped-def]
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


#: Different sets of random samples, shared by the seeds in turn. Wide margin: one good set is enough.
_SAMPLE_SETS = 64
# The others are those with which `bench.planes.run` finds the planes of the roofs labelled by hand.
#: Points of a plane that are closer than this are connected [spacings].
_CONNECTION_RADIUS = 3.0
#: Points may lie off their plane by this many times the measured noise, three standard deviations.
_MAX_NOISE_RATIO = 3.0
#: Weight of a point's neighbours against its distances when two planes claim it.
_SMOOTHNESS = 1.0


def connected_planes(
    points: FloatArray, spacing: float, min_points: int, config: PlaneFittingConfig
) -> NDArray[np.int32]:
    """Number the points of each plane, in any order and with repetitions; 0 = none."""
    if len(points) < min_points:
        return np.zeros(len(points), dtype=np.int32)
    cloud, row_of, noise = survey_points(points, _CONNECTION_RADIUS * spacing)
    distance = max(config.max_plane_distance, _MAX_NOISE_RATIO * noise)
    prices = prices_of(distance, noise, spacing)
    labels = _extracted(cloud, distance, min_points, config)
    seam = seam_points(cloud.neighbours, labels)
    labels = select_planes(cloud, labels, seam, prices)
    labels = refine_labels(cloud, labels, seam, distance, _SMOOTHNESS)
    labels = split_planes(cloud.neighbours, labels, min_points)
    labels = select_planes(cloud, labels, seam_points(cloud.neighbours, labels), prices)
    return labels[row_of]


def _extracted(
    cloud: Cloud, distance: float, min_points: int, config: PlaneFittingConfig
) -> NDArray[np.int32]:
    """Take planes out of the cloud one after the other."""
    limits = Limits(
        distance,
        math.cos(math.radians(config.max_normal_angle_deg)),
        math.cos(math.radians(config.max_slope_deg)),
        min_points,
    )
    chance = np.random.default_rng(config.random_state)
    n_samples = samples_needed(PROBABILITY, config.outlier_share, 3)
    samples = chance.random((_SAMPLE_SETS, n_samples, 2))
    order = chance.permutation(len(cloud.points))
    # Planes are found from the inside: what lies by ridges and rims comes last.
    order = np.concatenate([order[cloud.is_smooth[order]], order[~cloud.is_smooth[order]]])
    return extract(cloud, limits, order, samples)


@kernel
def split_planes(neighbours, labels, min_points):  # type: ignore[no-untyped-def]
    """
    Make every connected part of a plane a plane of its own; parts with too few points are dissolved.

    Neighbours are rows of near points, first those that there are, then −1.
    """
    part = connected_parts(neighbours, labels)
    size = np.zeros(len(part), np.int64)
    for i in range(len(part)):
        size[part[i]] += labels[i] > 0
    number = np.zeros(len(part), np.int32)
    n = 0
    for i in range(len(part)):
        if size[part[i]] < min_points:
            continue
        # A part is named after its lowest row, which therefore comes first.
        if part[i] == i:
            n += 1
            number[i] = n
        number[i] = number[part[i]]
    return number


@kernel
def connected_parts(neighbours: NDArray[np.int32], labels: NDArray[np.int32]) -> IntArray:
    """Return the lowest row of the connected part of one plane that each point is of."""
    part = np.arange(len(labels))
    for i in range(len(labels)):
        for j in neighbours[i]:
            if j < 0 or labels[i] == 0:
                break
            if labels[j] == labels[i] and part[j] != part[i]:
                link(part, i, np.int64(j))
    flatten(part)
    return part
