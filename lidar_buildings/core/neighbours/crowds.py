"""Crowds: places measured again and again, as by a scanner that stands still; few points tell all."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import CellGrid

#: Voxels along a column's side: nine centimetres for the columns of a dense cloud.
VOXELS_A_COLUMN = 4
#: Points that stand for a voxel: with fewer, strays count as much as the surface that they lie beside.
MOST = 4


def without_crowds(columns: CellGrid) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """
    Choose points that stand for all: of each voxel at most `MOST`, spread evenly over its heights.

    Pairs of neighbours grow with the square of the points at a place; of the chosen ones they do not.
    Returned is also which one of the chosen, in their order, stands for each point: itself, or one of its
    voxel.
    """
    is_chosen = np.empty(len(columns.points), dtype=np.bool_)
    place = np.empty(len(columns.points), dtype=np.int64)
    _choose(columns.points, columns.first, columns.size, is_chosen, place)
    return is_chosen, place


@kernel
def _choose(points, first, size, is_chosen, place):  # type: ignore[no-untyped-def]
    """Write which points are chosen, and which of the chosen stands for each."""
    room, n_chosen = 0, 0
    for k in range(len(first) - 1):
        room = max(room, first[k + 1] - first[k])
    voxel, count, n_seen = np.empty((3, room), dtype=np.int64)
    stands_for = np.empty((room, MOST), dtype=np.int64)
    newest = np.empty(VOXELS_A_COLUMN * VOXELS_A_COLUMN, dtype=np.int64)
    layer = np.empty(len(newest))
    for k in range(len(first) - 1):
        begin, end = first[k], first[k + 1]
        if end - begin <= MOST:  # no crowd
            for i in range(begin, end):
                is_chosen[i], place[i] = True, n_chosen
                n_chosen += 1
            continue
        newest[:], n_voxels = -1, 0
        for i in range(begin, end):
            # The points of a column rise, and so do the voxels of each stack in it.
            stack = 0
            for axis in range(2):
                part = math.floor(VOXELS_A_COLUMN * (points[i, axis] / size))
                part -= VOXELS_A_COLUMN * math.floor(part / VOXELS_A_COLUMN)
                stack = stack * VOXELS_A_COLUMN + np.int64(part)
            height = math.floor(VOXELS_A_COLUMN * (points[i, 2] / size))
            if newest[stack] < 0 or layer[stack] != height:
                newest[stack], layer[stack] = n_voxels, height
                count[n_voxels], n_seen[n_voxels] = 0, 0
                n_voxels += 1
            voxel[i - begin] = newest[stack]
            count[newest[stack]] += 1
        for i in range(begin, end):
            own = voxel[i - begin]
            n, n_shares = count[own], min(count[own], MOST)
            share = n_seen[own] * n_shares // n
            is_chosen[i] = n_seen[own] == -(-share * n // n_shares)  # the first of its share
            if is_chosen[i]:
                stands_for[own, share] = n_chosen
                n_chosen += 1
            n_seen[own] += 1
            place[i] = stands_for[own, share]
