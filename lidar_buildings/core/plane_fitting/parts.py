"""
Connected parts of planes: a plane whose parts lie apart is as many planes.

"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.linked_sets import flatten, link
from lidar_buildings.core.plane_fitting.surroundings import Cloud


def split_planes(
    cloud: Cloud, labels: NDArray[np.int32], min_points: int, bridge: float
) -> NDArray[np.int32]:
    """
    Make every connected part of a plane a plane of its own; parts with too few points are dissolved.

    Parameters
    ----------
    cloud : Cloud
    labels : ndarray of shape (n_points,), int32
        Plane numbers, 0 = none.
    min_points : int
        Fewest points of a part.
    bridge : float
        Large parts this near to one another are one, even where points of other planes lie between them, as
        at the foot of a valley [m].

    """
    part = np.arange(len(labels))
    _link_neighbours(cloud.neighbours, labels, part)
    is_large = (np.bincount(part, minlength=1) >= min_points)[part] & (labels > 0)
    kept = np.where(is_large, labels, 0).astype(np.int32)
    _link_across(cloud.points, cloud.neighbours, kept, part, bridge)
    number = np.zeros(len(labels), dtype=np.int32)
    number[is_large] = 1 + np.unique(part[is_large], return_inverse=True)[1].reshape(-1)
    return number


@njit(cache=True, nogil=True)
def _link_neighbours(
    neighbours: NDArray[np.int32], labels: NDArray[np.int32], part: NDArray[np.int64]
) -> None:
    """
    Link neighbouring points of one plane.

    """
    for i in range(len(labels)):
        if labels[i] == 0:
            continue
        for j in neighbours[i]:
            if j < 0:
                break
            if labels[j] == labels[i] and part[j] != part[i]:
                link(part, i, j)
    flatten(part)


@njit(cache=True, nogil=True)
def _link_across(
    points: NDArray[np.float64],
    neighbours: NDArray[np.int32],
    labels: NDArray[np.int32],
    part: NDArray[np.int64],
    bridge: float,
) -> None:
    """
    Link points of one plane that are neighbours of the same point of another, if near enough.

    """
    for i in range(len(labels)):
        for a in neighbours[i]:
            if a < 0:
                break
            if labels[a] == labels[i] or labels[a] == 0:
                continue
            for b in neighbours[i]:
                if b < 0:
                    break
                if b > a and labels[b] == labels[a] and part[a] != part[b]:
                    d = points[a] - points[b]
                    if d[0] ** 2 + d[1] ** 2 + d[2] ** 2 <= bridge**2:
                        link(part, a, b)
    flatten(part)
