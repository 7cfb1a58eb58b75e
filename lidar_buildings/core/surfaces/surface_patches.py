"""Patches: points joined to their neighbours wherever the surface goes on smoothly."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.neighbourhoods import build_grid, neighbours_of
from lidar_buildings.core.neighbours.union_find import flatten, link

#: Longest link where there are no points to say it [m].
MIN_LINK = 1e-3


def smooth_patches(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    radius: float | NDArray[np.float64],
    *,
    max_angle_deg: float,
    max_offset: float,
) -> NDArray[np.int64]:
    """
    Number the patches of points that are linked by smooth steps.

    Two points within the radius of either are linked if their normals differ by no more than an angle and
    each lies near the other's tangent plane; a patch is whatever links connect (smoothness constraint of
    Rabbani and others, 2006, without its seeds: the result does not depend on where growing starts).

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In any order [m].
    normals : ndarray of shape (n_points, 3)
        Unit normals.
    radius : float or ndarray of shape (n_points,)
        Longest link, of all points or of each [m], > 0.
    max_angle_deg : float
        Largest angle between linked normals [deg].
    max_offset : float
        Largest distance of a linked point from the other's tangent plane [m].

    Returns
    -------
    ndarray of int64, shape (n_points,)
        0, 1, … ; every point is in a patch, if only its own.
    """
    reach = np.broadcast_to(np.asarray(radius, dtype=np.float64), len(points))
    grid = build_grid(points, float(reach.max(initial=MIN_LINK)))
    parent = np.arange(len(grid.points))
    _link_smooth(
        grid, normals[grid.rows], reach[grid.rows], math.cos(math.radians(max_angle_deg)), max_offset, parent
    )
    return _numbered(parent, grid.rows)


def connected_parts(
    points: NDArray[np.float64], radius: float, *, in_plan: bool = False
) -> NDArray[np.int64]:
    """Number the parts of a cloud that are connected by steps no longer than a radius [m]."""
    grid = build_grid(points, radius)
    parent = np.arange(len(grid.points))
    _link_near(grid, radius, in_plan, parent)
    return _numbered(parent, grid.rows)


def plan_areas(points: NDArray[np.float64], labels: NDArray[np.int64], cell: float) -> NDArray[np.float64]:
    """Return the area of the grid cells that the points of each label 0, 1, … occupy [m²]."""
    if len(points) == 0:
        return np.zeros(0)
    x, y = np.floor(points[:, :2] / cell).T
    order = np.lexsort((y, x, labels))
    x, y, labels = x[order], y[order], labels[order]
    is_new = np.ones(len(points), dtype=bool)
    is_new[1:] = (np.diff(x) != 0) | (np.diff(y) != 0) | (np.diff(labels) != 0)
    return np.bincount(labels[is_new]).astype(np.float64) * cell**2


def _numbered(parent: NDArray[np.int64], rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Turn the links between sorted points into numbers 0, 1, … per input row."""
    flatten(parent)
    numbers = np.empty(len(parent), dtype=np.int64)
    is_root = np.zeros(len(parent), dtype=bool)
    is_root[parent] = True
    numbers[rows] = (np.cumsum(is_root) - 1)[parent]
    return numbers


@njit(cache=True, nogil=True)
def _link_near(grid, radius, in_plan, parent):  # type: ignore[no-untyped-def]
    near = np.empty(len(grid.points), dtype=np.int64)
    for i in range(len(grid.points)):
        x, y, z = grid.points[i]
        for k in range(neighbours_of(grid, grid.cell[i], x, y, z, radius, in_plan, near)):
            if near[k] > i:
                link(parent, i, near[k])


@njit(cache=True, nogil=True)
def _link_smooth(grid, normals, reach, min_cosine, max_offset, parent):  # type: ignore[no-untyped-def]
    points = grid.points
    near = np.empty(len(points), dtype=np.int64)
    for i in range(len(points)):
        x, y, z = points[i]
        a, b, c = normals[i]
        for k in range(neighbours_of(grid, grid.cell[i], x, y, z, reach[i], False, near)):
            j = near[k]
            # One that reaches back finds this link itself.
            if j == i or (j < i and reach[j] >= reach[i]):
                continue
            u, v, w = normals[j]
            dx, dy, dz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
            if (
                abs(a * u + b * v + c * w) >= min_cosine
                and abs(a * dx + b * dy + c * dz) <= max_offset
                and abs(u * dx + v * dy + w * dz) <= max_offset
            ):
                link(parent, i, j)
