"""Borders between the regions of planes: the sides of cells at which one ends and another begins."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.stages.roof_topology.region_raster import RegionRaster


class Borders(NamedTuple):
    """Sides of cells between two regions, sorted by the pair of planes."""

    xy: FloatArray  #: middle of the side, about the building's centre [m], shape (n_sides, 2)
    upright: BoolArray  #: whether the side runs north-south, shape (n_sides,)
    #: Numbers of the two planes, ``first < second``, shape (n_sides,).
    first: NDArray[np.int32]
    second: NDArray[np.int32]
    #: Rows of the two planes' points that are nearest to the cells on either side, shape (n_sides,).
    near_first: NDArray[np.int32]
    near_second: NDArray[np.int32]
    #: Distance of the farther of these two points from its cell's middle [m], shape (n_sides,).
    gap: FloatArray
    #: Pair k has the sides ``start[k]`` to ``start[k + 1]`` (exclusive), shape (n_pairs + 1,).
    start: IntArray
    cell: float  #: length of a side [m]


def find_borders(raster: RegionRaster, centre: FloatArray) -> Borders:
    """Collect the sides of cells between different planes, with positions about a centre."""
    label = raster.label
    numbers, place = np.empty((2 * label.size, 4), dtype=np.int32), np.empty((2 * label.size, 4))
    n = _fill(label, raster.nearest, raster.square, numbers, place)
    numbers, place = numbers[:n], place[:n]
    key = numbers[:, 0].astype(np.int64) << 32 | numbers[:, 1]
    order = np.argsort(key, kind="stable")
    numbers, place, key = numbers[order], place[order], key[order]
    changes = np.flatnonzero(key[1:] != key[:-1]) + 1
    start = np.concatenate([[0], changes, [n]]) if n else np.zeros(1, dtype=np.int64)
    origin = np.array([raster.west - centre[0], raster.south - centre[1]])
    return Borders(
        origin + raster.cell * place[:, :2],
        place[:, 2] > 0,
        numbers[:, 0],
        numbers[:, 1],
        numbers[:, 2],
        numbers[:, 3],
        place[:, 3],
        start.astype(np.int64),
        raster.cell,
    )


@kernel
def _fill(label, nearest, square, numbers, place):  # type: ignore[no-untyped-def]
    """
    Write planes and nearest points of each side, and its middle in cells, whether it is upright, and its gap.

    Return how many there are.
    """
    n = 0
    n_rows, n_columns = label.shape
    for r in range(n_rows):
        for c in range(n_columns):
            a = label[r, c]
            if a == 0:
                continue
            for upright in range(2):
                rr, cc = r + 1 - upright, c + upright
                if rr >= n_rows or cc >= n_columns or label[rr, cc] == 0 or label[rr, cc] == a:
                    continue
                b = label[rr, cc]
                i, j = nearest[r, c], nearest[rr, cc]
                if a < b:
                    numbers[n, 0], numbers[n, 1], numbers[n, 2], numbers[n, 3] = a, b, i, j
                else:
                    numbers[n, 0], numbers[n, 1], numbers[n, 2], numbers[n, 3] = b, a, j, i
                place[n, 0] = c + (1.0 if upright else 0.5)
                place[n, 1] = r + (0.5 if upright else 1.0)
                place[n, 2] = upright
                place[n, 3] = math.sqrt(max(square[r, c], square[rr, cc]))
                n += 1
    return n
