"""
What follows the extraction: points move to the plane that fits them best, planes join or fall apart.

"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.least_squares_plane import least_squares_plane
from lidar_buildings.core.plane_fitting.consensus import Cloud
from lidar_buildings.core.plane_fitting.plane_geometry import distance_to

#: Rounds in which points may change their plane; few move after the third.
_MAX_ROUNDS = 5
#: Share of each plane's points that a joint plane has to hold.
_JOINT_SHARE = 0.9


def plane_equations(points: NDArray[np.float64], labels: NDArray[np.int32]) -> NDArray[np.float64]:
    """
    Return (a, b, c, d) of every plane's least-squares plane by its number; row 0 and unused rows are void.

    """
    size = int(labels.max(initial=0)) + 1
    count = np.maximum(np.bincount(labels, minlength=size), 1)
    centroid = np.column_stack([np.bincount(labels, axis, size) / count for axis in points.T])
    offsets = points - centroid[labels]
    scatter = np.empty((size, 3, 3))
    for a, b in zip(*np.triu_indices(3), strict=True):
        scatter[:, a, b] = scatter[:, b, a] = np.bincount(labels, offsets[:, a] * offsets[:, b], size)
    normals = np.linalg.eigh(scatter)[1][:, :, 0]
    normals[normals[:, 2] < 0] *= -1.0
    return np.column_stack([normals, -np.einsum("ij,ij->i", normals, centroid)])


def rows_by_label(labels: NDArray[np.int32]) -> list[tuple[int, NDArray[np.intp]]]:
    """
    Return (number, rows) of every plane by rising number.

    """
    order = np.argsort(labels, kind="stable")
    numbers, first = np.unique(labels[order], return_index=True)
    groups = np.split(order, first[1:])
    return [(int(number), rows) for number, rows in zip(numbers, groups, strict=True) if number]


def settle(
    cloud: Cloud, labels: NDArray[np.int32], max_distance: float, smoothness: float
) -> NDArray[np.int32]:
    """
    Let every point choose among the planes around it, until none moves.

    The first plane extracted takes a strip of its neighbours where they meet; here these points go to the
    plane that they are nearest to, and points that no plane took join the one beside them.

    Parameters
    ----------
    cloud : Cloud
    labels : ndarray of shape (n_points,)
        Plane numbers, 0 = none.
    max_distance : float
        Largest distance of a point to its plane [m].
    smoothness : float
        Weight of the neighbours' planes against the squared relative distance.

    """
    for _ in range(_MAX_ROUNDS):
        moved = choose(cloud, labels, plane_equations(cloud.points, labels), max_distance, smoothness)
        if np.array_equal(moved, labels):
            break
        labels = moved
    return labels


@njit(cache=True, nogil=True)
def choose(
    cloud: Cloud,
    labels: NDArray[np.int32],
    equations: NDArray[np.float64],
    max_distance: float,
    smoothness: float,
) -> NDArray[np.int32]:
    """
    Return every point's cheapest plane among its own and its neighbours', all points at once.

    """
    chosen = np.zeros_like(labels)
    for i in range(len(labels)):
        best = np.inf
        for k in range(-1, cloud.neighbours.shape[1]):
            j = i if k < 0 else cloud.neighbours[i, k]
            if j < 0 or labels[j] == 0 or labels[j] == chosen[i]:
                continue
            distance = distance_to(equations[labels[j]], cloud.points[i])
            if distance > max_distance:
                continue
            cost = (distance / max_distance) ** 2 - smoothness * share(cloud.neighbours[i], labels, labels[j])
            if cost < best:
                best = cost
                chosen[i] = labels[j]
    return chosen


@njit(cache=True, nogil=True)
def share(neighbours: NDArray[np.int32], labels: NDArray[np.int32], label: int) -> float:
    """
    Return the share of a point's neighbours that lie in a plane.

    """
    n, n_same = 0, 0
    for j in neighbours:
        if j >= 0:
            n += 1
            n_same += labels[j] == label
    return n_same / n if n else 0.0


def join(
    cloud: Cloud, labels: NDArray[np.int32], max_distance: float, max_angle_deg: float
) -> NDArray[np.int32]:
    """
    Join neighbouring planes of nearly the same normal where one plane fits both.

    """
    members = dict(rows_by_label(labels))
    now = np.arange(int(labels.max(initial=0)) + 1, dtype=np.int32)
    equations = plane_equations(cloud.points, labels)
    cosine = np.cos(np.radians(max_angle_deg))
    for first, second in touching(cloud.neighbours, labels):
        a, b = now[first], now[second]
        if a == b or equations[a, :3] @ equations[b, :3] < cosine:
            continue
        if not one_plane_fits(cloud.points[members[a]], cloud.points[members[b]], max_distance):
            continue
        members[a] = np.sort(np.concatenate([members[a], members[b]]))
        normal, centroid, _ = least_squares_plane(cloud.points[members[a]])
        equations[a] = *normal, -normal @ centroid
        now[now == b] = a
    return now[labels]


def touching(neighbours: NDArray[np.int32], labels: NDArray[np.int32]) -> NDArray[np.int64]:
    """
    Return the pairs of planes, shape (n_pairs, 2), that have neighbouring points.

    """
    size = int(labels.max(initial=0)) + 1
    pairs = np.unique(touching_numbers(neighbours, labels, size))
    return np.column_stack([pairs // size, pairs % size])


@njit(cache=True, nogil=True)
def touching_numbers(
    neighbours: NDArray[np.int32], labels: NDArray[np.int32], size: int
) -> NDArray[np.int64]:
    """
    Return first × size + second for neighbouring points of two planes, the smaller number first.

    """
    numbers = np.empty(neighbours.size, np.int64)
    n = 0
    for i in range(len(labels)):
        before = labels[i]
        for j in neighbours[i]:
            # A point mostly has many neighbours in the same other plane: one of a run is enough.
            if j < 0 or labels[j] == before:
                continue
            before = labels[j]
            if labels[i] > 0 and labels[j] > 0 and labels[i] != labels[j]:
                numbers[n] = min(labels[i], labels[j]) * size + max(labels[i], labels[j])
                n += 1
    return numbers[:n]


def one_plane_fits(first: NDArray[np.float64], second: NDArray[np.float64], max_distance: float) -> bool:
    """
    Whether the joint least-squares plane holds nearly all points of each of two sets.

    """
    normal, centroid, _ = least_squares_plane(np.concatenate([first, second]))
    return all(
        np.mean(np.abs((points - centroid) @ normal) <= max_distance) >= _JOINT_SHARE
        for points in (first, second)
    )


def split(neighbours: NDArray[np.int32], labels: NDArray[np.int32], min_points: int) -> NDArray[np.int32]:
    """
    Make every connected part of a plane a plane of its own; parts with too few points are dissolved.

    """
    part = connected_parts(neighbours, labels)
    large = np.bincount(part, minlength=1)[part] >= min_points
    return np.where(large & (labels > 0), part + 1, 0).astype(np.int32)


@njit(cache=True, nogil=True)
def connected_parts(neighbours: NDArray[np.int32], labels: NDArray[np.int32]) -> NDArray[np.int32]:
    """
    Number the connected parts of equal labels from 0, in the order of their first points.

    """
    leader = np.arange(len(labels), dtype=np.int32)
    for i in range(len(labels)):
        for j in neighbours[i]:
            if j >= 0 and labels[j] == labels[i]:
                a, b = leader_of(leader, i), leader_of(leader, j)
                leader[max(a, b)] = min(a, b)
    part = np.empty(len(labels), dtype=np.int32)
    n = 0
    for i in range(len(labels)):
        first = leader_of(leader, i)
        if first == i:
            part[i] = n
            n += 1
        else:
            part[i] = part[first]
    return part


@njit(cache=True, nogil=True)
def leader_of(leader: NDArray[np.int32], member: int) -> int:
    """
    Return the first point of a point's part, and shorten the way there.

    """
    while leader[member] != member:
        leader[member] = leader[leader[member]]
        member = leader[member]
    return member
