"""
The point spacing of one building from a sample of its points, mostly within a percent of that from all.

A building of 6,000 points takes 0.8 ms, `measure_spacing` 7 ms.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.point_spacing import MAX_STRAY, NEIGHBOURS, measure_spacing

#: Positions at which the density is probed.
MAX_PROBES = 256
#: A cell's side in units of 1/√density for each √neighbour.
_CELL = 0.45
#: Fewest points that a sample is taken of.
_FEWEST = 40


def sampled_spacing(points: FloatArray) -> float:
    """
    Measure the point spacing as `measure_spacing`, at some of the positions only where there are many.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In an order that depends on the points alone [m].

    Returns
    -------
    float
        Spacing [m], > 0.
    """
    low, extent = points.min(axis=0, initial=math.inf), np.ptp(points, axis=0) if len(points) else np.zeros(3)
    # As if the points filled their bounding box: cells a little too large only cost time.
    side = _CELL * math.sqrt((NEIGHBOURS + 1) * extent[0] * extent[1] / max(len(points), 1))
    if len(points) < _FEWEST or not 0.0 < side < math.inf or extent[:2].sum() / side > len(points):
        return measure_spacing(points)
    squares, n_nearest = np.empty(MAX_PROBES), np.zeros(1, dtype=np.int64)
    n = _probe(points, low[0], low[1], side, extent[0], extent[1], squares, n_nearest)
    distance = np.sqrt(np.sort(squares[:n]))
    area = np.cumsum(np.minimum(distance, MAX_STRAY * np.median(distance)) ** 2)
    middle = float(distance[np.searchsorted(area, 0.5 * area[-1])])
    return middle * math.sqrt(math.pi / (n_nearest[0] + 1 / 3))


@njit(cache=True, nogil=True)
def _probe(
    points: FloatArray,
    west: float,
    south: float,
    side: float,
    width: float,
    height: float,
    squares: FloatArray,
    n_nearest: IntArray,
) -> int:
    """Write the squared distances from some positions to their n-th neighbours; return how many there are."""
    n_columns, n_rows = int(width / side) + 1, int(height / side) + 1
    first = np.zeros(n_columns * n_rows + 1, dtype=np.int64)
    cell = np.empty(len(points), dtype=np.int64)
    for i in range(len(points)):
        u = min(int((points[i, 0] - west) / side), n_columns - 1)
        v = min(int((points[i, 1] - south) / side), n_rows - 1)
        cell[i] = v * n_columns + u
        first[cell[i] + 1] += 1
    for c in range(n_columns * n_rows):
        first[c + 1] += first[c]
    end, n_distinct = first.copy(), 0
    x, y = np.empty(len(points)), np.empty(len(points))
    for i in range(len(points)):
        c, is_new = cell[i], True
        for j in range(first[c], end[c]):
            if x[j] == points[i, 0] and y[j] == points[i, 1]:
                is_new = False
        if is_new:
            x[end[c]], y[end[c]] = points[i, 0], points[i, 1]
            end[c] += 1
            n_distinct += 1
    n = min(NEIGHBOURS, max(1, n_distinct // 10))
    n_nearest[0] = n
    stride = (n_distinct + MAX_PROBES - 1) // MAX_PROBES
    nearest = np.empty(n + 1)
    count, n_probes = 0, 0
    for c in range(n_columns * n_rows):
        for i in range(first[c], end[c]):
            count += 1
            if (count - 1) % stride:
                continue
            nearest[:] = np.inf
            reach = 0
            while nearest[n] > (reach - 1) * side * (reach - 1) * side or reach < 2:
                if reach > max(n_columns, n_rows):
                    break
                for v in range(max(c // n_columns - reach, 0), min(c // n_columns + reach, n_rows - 1) + 1):
                    is_row = abs(v - c // n_columns) == reach
                    for u in range(
                        max(c % n_columns - reach, 0), min(c % n_columns + reach, n_columns - 1) + 1
                    ):
                        if not is_row and abs(u - c % n_columns) != reach:
                            continue
                        for j in range(first[v * n_columns + u], end[v * n_columns + u]):
                            square = (x[j] - x[i]) ** 2 + (y[j] - y[i]) ** 2
                            if square < nearest[n]:
                                k = n
                                while k > 0 and nearest[k - 1] > square:
                                    nearest[k] = nearest[k - 1]
                                    k -= 1
                                nearest[k] = square
                reach += 1
            if nearest[n] < np.inf:
                squares[n_probes] = nearest[n]
                n_probes += 1
    return n_probes
