"""The regions of a roof's planes as a raster, and the borders between them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.model.point_array import extent_of

#: Side of a cell in point spacings.
CELL = 0.5
#: Points of other cells are farther from a cell's middle than half its side [square of the side].
_NEARER = 0.249
#: Cells are enlarged until so many suffice.
_MAX_CELLS = 4_000_000
#: Where the outline reaches beyond the points by more than their extent and so much [m], it is cut.
_LEAST_MARGIN = 20.0


class RegionRaster(NamedTuple):
    """Which plane lies where."""

    label: NDArray[np.int32]  #: number of the plane, 0 = outside the roof, shape (n_rows, n_columns)
    nearest: NDArray[np.int32]  #: row of the nearest point of a plane, -1 = none, shape (n_rows, n_columns)
    #: Of the distance from the cell's middle to that point [m²], shape (n_rows, n_columns).
    square: FloatArray
    #: Corner of the first cell [m]; a multiple of `cell`.
    west: float
    south: float
    cell: float  #: side of a cell [m]


def region_raster(
    points: FloatArray, plane_id: NDArray[np.uint16], rings: tuple[FloatArray, ...], spacing: float
) -> RegionRaster:
    """Give each cell inside an outline's rings the plane of its nearest point that is in one."""
    low, high = extent_of(points)[:, :2]
    reach = np.maximum(high - low, _LEAST_MARGIN)
    low, high = (
        np.maximum(np.minimum(low, rings[0].min(axis=0)), low - reach),
        np.minimum(np.maximum(high, rings[0].max(axis=0)), high + reach),
    )
    cell = CELL * spacing
    while np.prod((high - low) / cell + 5.0) > _MAX_CELLS:
        cell *= 2.0
    margin = 2
    column, row = (math.floor(v / cell) - margin for v in low)
    n_columns, n_rows = (
        math.floor(v / cell) - first + 1 + margin for v, first in zip(high, (column, row), strict=True)
    )
    west, south = column * cell, row * cell
    nearest = np.full((n_rows, n_columns), -1, dtype=np.int32)
    square = np.full((n_rows, n_columns), np.inf)
    _nearest_points(points, plane_id, west, south, cell, nearest, square)
    label = np.zeros((n_rows, n_columns), dtype=np.int32)
    ends = np.cumsum([len(ring) for ring in rings])
    _label_inside(np.concatenate(rings), ends, west, south, cell, nearest, plane_id, label)
    return RegionRaster(label, nearest, square, west, south, cell)


@kernel
def _nearest_points(points, plane_id, west, south, cell, nearest, square):  # type: ignore[no-untyped-def]
    """Give every cell the nearest point of a plane, handed on by its neighbours, and the square."""
    n_rows, n_columns = nearest.shape
    for i in range(len(points)):
        if plane_id[i] == 0:
            continue
        c, r = int((points[i, 0] - west) / cell), int((points[i, 1] - south) / cell)
        x, y = west + (c + 0.5) * cell, south + (r + 0.5) * cell
        d = (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2
        if d < square[r, c] or (d == square[r, c] and plane_id[i] < plane_id[nearest[r, c]]):
            square[r, c] = d
            nearest[r, c] = i
    for turn in range(2):
        step = 1 if turn == 0 else -1
        for rr in range(n_rows):
            r = rr if turn == 0 else n_rows - 1 - rr
            y = south + (r + 0.5) * cell
            for second in range(2):
                along = -1 if turn == second else 1
                # The way back along a row needs no second look at the row before.
                last = 4 if second == 0 and 0 <= r - step < n_rows else 1
                for cc in range(n_columns):
                    c = cc if along < 0 else n_columns - 1 - cc
                    x = west + (c + 0.5) * cell
                    least, own = square[r, c], nearest[r, c]
                    if least < _NEARER * cell * cell:
                        continue
                    for k in range(last):
                        pr, pc = (r, c + along) if k == 0 else (r - step, c + k - 2)
                        if pc < 0 or pc >= n_columns:
                            continue
                        i = nearest[pr, pc]
                        if i < 0 or i == own:
                            continue
                        d = (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2
                        if d < least or (d == least and plane_id[i] < plane_id[own]):
                            least, own = d, i
                    square[r, c], nearest[r, c] = least, own


@kernel
def _label_inside(vertices, ends, west, south, cell, nearest, plane_id, label):  # type: ignore[no-untyped-def]
    """Label the cells whose middle lies inside an odd number of rings."""
    n_rows, n_columns = label.shape
    crossings = np.empty(len(vertices))
    for r in range(n_rows):
        y = south + (r + 0.5) * cell
        n = _crossings(vertices, ends, y, crossings)
        if n == 0:
            continue
        for k in range(0, n - 1, 2):
            c0 = max(math.ceil((crossings[k] - west) / cell - 0.5), 0)
            c1 = min(math.floor((crossings[k + 1] - west) / cell - 0.5), n_columns - 1)
            for c in range(c0, c1 + 1):
                if nearest[r, c] >= 0:
                    label[r, c] = plane_id[nearest[r, c]]


@kernel
def _crossings(vertices, ends, y, crossings):  # type: ignore[no-untyped-def]
    """Write where the rings cross a line of constant y, from west to east; return how often they do."""
    n, first = 0, 0
    for end in ends:
        j = end - 1
        for i in range(first, end):
            if (vertices[i, 1] > y) != (vertices[j, 1] > y):
                t = (y - vertices[i, 1]) / (vertices[j, 1] - vertices[i, 1])
                x, k = vertices[i, 0] + t * (vertices[j, 0] - vertices[i, 0]), n
                while k > 0 and crossings[k - 1] > x:
                    crossings[k] = crossings[k - 1]
                    k -= 1
                crossings[k] = x
                n += 1
            j = i
        first = end
    return n


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
    place, key = place[order], key[order]
    changes = np.flatnonzero(key[1:] != key[:-1]) + 1
    start = np.concatenate([[0], changes, [n]]) if n else np.zeros(1, dtype=np.int64)
    origin = np.array([raster.west - centre[0], raster.south - centre[1]])
    xy, (_, _, upright, gap) = origin + raster.cell * place[:, :2], np.ascontiguousarray(place.T)
    first, second, near_first, near_second = np.ascontiguousarray(numbers[order].T)
    return Borders(
        xy, upright > 0, first, second, near_first, near_second, gap, start.astype(np.int64), raster.cell
    )


@kernel
def _fill(label, nearest, square, numbers, place):  # type: ignore[no-untyped-def]
    """Write planes, nearest points, middle, uprightness and gap of each side; return how many."""
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
