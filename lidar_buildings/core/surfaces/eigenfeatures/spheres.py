"""
From the neighbours of each point to the radius of least entropy and the eigenvalues and normal there.

Candidates are gathered once for the points of a cell, and radii are judged by the batch, so that the loops
over candidates and over radii are long and plain enough to become vector instructions.
"""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.windows import first_windows, move_windows
from lidar_buildings.core.surfaces.eigenfeatures.entropy import entropy_of_shape
from lidar_buildings.core.surfaces.eigenfeatures.moments import (
    MAX_CANDIDATES,
    gather_window,
    rows_within,
    sum_shells,
)
from lidar_buildings.core.surfaces.point_moments import N_MOMENTS
from lidar_buildings.core.surfaces.symmetric_eigen import values_and_normal

#: Cells that a window extends on each side: they are as wide as the largest radius. With smaller ones there
#: are fewer candidates, but fewer points share them, which takes longer in all.
WINDOW_REACH = 1
#: Neighbourhoods that are judged together, one for each radius of some points; as many radii are allowed.
BATCH_ROWS = 512
#: Numbers of a covariance, and as many are what `values_and_normal` makes of it.
N_COVARIANCE = 6


@kernel
def describe_cells(cloud, squares, lookup, min_neighbours, found, begin, end):  # type: ignore[no-untyped-def]
    """
    Describe the neighbourhoods of the points in some cells.

    Parameters
    ----------
    cloud : CellGrid
        Points in cells as wide as the largest radius, or more.
    squares : ndarray of shape (n_radii,)
        Rising squares of the radii [m²].
    lookup : ndarray of uint64
        What `shell_lookup` says of them.
    min_neighbours : int
        Radii with fewer points are passed over, but for the largest one.
    found : tuple of arrays
        One row per input row, in the order of the attributes of `EigenFeatures`.
    begin, end : int
        Which of the occupied cells.
    """
    reach = math.sqrt(squares[-1])
    z = cloud.points[:, 2]
    near = np.empty((3, MAX_CANDIDATES + (2 * WINDOW_REACH + 1) ** 2))
    square, rows = np.empty(near.shape[1]), np.empty(near.shape[1], dtype=np.uint64)
    shells = np.empty((len(squares), N_MOMENTS))
    batch = np.empty((N_MOMENTS + 1) * BATCH_ROWS)
    waiting, n_waiting = np.empty(BATCH_ROWS // len(squares), dtype=np.int64), 0
    windows = first_windows(cloud.numbers, cloud.n_columns, WINDOW_REACH, begin)
    for cell in range(begin, end):
        move_windows(cloud.numbers, cloud.n_columns, WINDOW_REACH, cell, windows)
        stop = cloud.first[cell]
        while stop < cloud.first[cell + 1]:
            start, stop = stop, _end_of_run(z, stop, cloud.first[cell + 1], reach)
            n_near = gather_window(cloud, windows, z[start] - reach, z[stop - 1] + reach, near)
            for i in range(start, stop):
                position = (cloud.points[i, 0], cloud.points[i, 1], z[i])
                n_rows = rows_within(near, n_near, position, squares[-1], square, rows)
                sum_shells(near, rows[:n_rows], position, square, squares, lookup, shells)
                _add_to_batch(shells, batch, n_waiting)
                waiting[n_waiting] = cloud.rows[i]
                n_waiting += 1
                if n_waiting == len(waiting):
                    _finish(batch, waiting, squares, min_neighbours, found)
                    n_waiting = 0
    _finish(batch, waiting[:n_waiting], squares, min_neighbours, found)


@kernel
def _end_of_run(z, start, last, height):  # type: ignore[no-untyped-def]
    """Return where the points that rise from z[start] by no more than a height end."""
    stop = start + 1
    while stop < last and z[stop] <= z[start] + height:
        stop += 1
    return stop


@kernel
def _add_to_batch(shells, batch, slot):  # type: ignore[no-untyped-def]
    """Add up the shells of a point, so that there are sums within each radius."""
    n_radii = len(shells)
    for moment in range(N_MOMENTS):
        total = 0.0
        row = moment * BATCH_ROWS + slot * n_radii
        for k in range(n_radii):
            total += shells[k, moment]
            batch[row + k] = total


@kernel
def _finish(batch, waiting, squares, min_neighbours, found):  # type: ignore[no-untyped-def]
    """Choose the radius of each point of a batch and write what is found there."""
    n_radii = len(squares)
    _judge(batch, len(waiting) * n_radii)
    chosen = np.empty(len(waiting), dtype=np.int64)
    for slot in range(len(waiting)):
        chosen[slot] = slot * n_radii + _least_entropy(batch, slot * n_radii, n_radii, min_neighbours)
    shapes = _shapes_of(batch, chosen)
    eigenvalues, normals, radius, n_neighbours = found
    for slot in range(len(waiting)):
        row = waiting[slot]
        for k in range(3):
            eigenvalues[row, k] = shapes[k, slot]
            normals[row, k] = shapes[3 + k, slot]
        radius[row] = math.sqrt(squares[chosen[slot] % n_radii])
        n_neighbours[row] = int(batch[chosen[slot]])


@kernel
def _judge(batch, n_rows):  # type: ignore[no-untyped-def]
    """Put the entropy of the batch's rows behind their sums."""
    for row in range(n_rows):
        entropy = entropy_of_shape(*_covariance(batch, row))
        batch[N_MOMENTS * BATCH_ROWS + row] = entropy


@kernel
def _least_entropy(batch, first, n_radii, min_neighbours):  # type: ignore[no-untyped-def]
    """
    Return the radius of least entropy among those with enough neighbours, the largest one if there is none.
    """
    best, least = n_radii - 1, np.inf
    for k in range(n_radii):
        entropy = batch[N_MOMENTS * BATCH_ROWS + first + k]
        if entropy < least and (batch[first + k] >= min_neighbours or k == n_radii - 1):
            best, least = k, entropy
    return best


@kernel
def _shapes_of(batch, rows):  # type: ignore[no-untyped-def]
    """Return eigenvalues and normals of the batch's chosen rows, a number a row, a row a column."""
    shapes = np.empty((N_COVARIANCE, BATCH_ROWS))
    for i in range(len(rows)):
        covariance = _covariance(batch, rows[i])
        for k in range(N_COVARIANCE):
            shapes[k, i] = covariance[k]
    for i in range(len(rows)):
        found = values_and_normal(
            shapes[0, i], shapes[1, i], shapes[2, i], shapes[3, i], shapes[4, i], shapes[5, i]
        )
        for k in range(N_COVARIANCE):
            shapes[k, i] = found[k]
    return shapes


@kernel
def _covariance(batch, row):  # type: ignore[no-untyped-def]
    """Return xx, xy, xz, yy, yz, zz of the covariance about the mean, 0 for fewer than two points."""
    share = 1.0 / max(batch[row], 1.0)
    x = batch[BATCH_ROWS + row] * share
    y = batch[2 * BATCH_ROWS + row] * share
    z = batch[3 * BATCH_ROWS + row] * share
    return (
        max(batch[4 * BATCH_ROWS + row] * share - x * x, 0.0),
        batch[5 * BATCH_ROWS + row] * share - x * y,
        batch[6 * BATCH_ROWS + row] * share - x * z,
        max(batch[7 * BATCH_ROWS + row] * share - y * y, 0.0),
        batch[8 * BATCH_ROWS + row] * share - y * z,
        max(batch[9 * BATCH_ROWS + row] * share - z * z, 0.0),
    )
