"""What speaks for one plane or another over an outline: points, and spots without any."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.stages.building_model.arrangement import walls_of
from lidar_buildings.core.stages.building_model.outline_coverage import is_inside

#: Spots farther than this from any point are without data [spacings].
EMPTY_DISTANCE = 2.0
#: No point within that distance of a spot lies more cells of the raster from it: two, and one for rounding.
_REACH = 3
#: Most spots of the raster.
_MAX_SPOTS = 40_000


@dataclass(frozen=True, eq=False)
class Samples:
    """
    What speaks for one plane or another over an outline.

    Attributes
    ----------
    points : ndarray of shape (n_samples, 3)
        Points; then spots without data, whose z means nothing [m].
    weight : ndarray of shape (n_samples,)
        Area that each stands for [m²].
    plane : ndarray of shape (n_samples,), int64
        Row of the plane nearest to a spot without data, -1 for points.
    """

    points: FloatArray
    weight: FloatArray
    plane: IntArray


def make_samples(
    points: FloatArray, plane_id: NDArray[np.uint16], outline: Outline, spacing: float
) -> Samples:
    """
    Weigh points by the area they stand for, and find the spots without any.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        Roof points [m].
    plane_id : ndarray of shape (n_points,)
        Number of each point's plane, 0 = none.
    outline : Outline
        Of the building [m].
    spacing : float
        Point spacing [m].
    """
    x, y = outline.exterior.T
    west, south, east, north = float(x.min()), float(y.min()), float(x.max()), float(y.max())
    step = max(spacing, ((east - west) * (north - south) / _MAX_SPOTS) ** 0.5)
    # Whole multiples of the step, so that the raster does not hang on the outline.
    column, row = math.floor(west / step), math.floor(south / step)
    n_columns, n_rows = math.floor(east / step) - column + 1, math.floor(north / step) - row + 1
    weight, spots = np.empty(len(points)), np.zeros((n_columns * n_rows, 3))
    plane = np.empty(len(spots), dtype=np.int64)
    n_spots = _weigh(
        points, plane_id, walls_of(outline).reshape(-1, 4), step, column - _REACH, row - _REACH,
        n_columns + 2 * _REACH, n_rows + 2 * _REACH, EMPTY_DISTANCE * spacing, weight, spots, plane,
    )  # fmt: skip
    no_plane = np.full(len(points), -1, dtype=np.int64)
    if not n_spots:
        return Samples(points, weight, no_plane)
    return Samples(
        np.concatenate([points, spots[:n_spots]]),
        np.concatenate([weight, np.full(n_spots, step**2)]),
        np.concatenate([no_plane, plane[:n_spots]]),
    )


@kernel
def _weigh(  # type: ignore[no-untyped-def]
    points, plane_id, walls, step, column, row, n_columns, n_rows, reach, weight, spots, plane
):  # fmt: skip
    """Write points' weights, the spots inside without a point near, and their planes; return how many."""
    first = np.zeros(n_columns * n_rows + 1, np.int64)
    cell, items = np.full(len(points), -1), np.empty(len(points), np.int64)
    for i in range(len(points)):
        c, r = math.floor(points[i, 0] / step) - column, math.floor(points[i, 1] / step) - row
        if 0 <= c < n_columns and 0 <= r < n_rows:
            cell[i] = c * n_rows + r
            first[cell[i]] += 1
    for i in range(len(points)):
        # Points beside the raster count for no cell.
        weight[i] = step**2 / first[cell[i]] if cell[i] >= 0 else 0.0
    for k in range(1, len(first)):
        first[k] += first[k - 1]
    for i in range(len(points) - 1, -1, -1):
        if cell[i] >= 0:
            first[cell[i]] -= 1
            items[first[cell[i]]] = i
    first_wall, at_row = _walls_at_rows(walls, step, row, n_rows)
    n_spots = 0
    for c in range(_REACH, n_columns - _REACH):
        for r in range(_REACH, n_rows - _REACH):
            k = c * n_rows + r
            if first[k] < first[k + 1]:
                continue
            x, y = (c + column + 0.5) * step, (r + row + 0.5) * step
            is_far = True
            for turn in range(2 * _REACH + 1):
                # From the middle outwards.
                beside = c + (turn + 1) // 2 * (1 if turn % 2 else -1)
                for m in range(first[beside * n_rows + r - _REACH], first[beside * n_rows + r + _REACH + 1]):
                    i = items[m]
                    away = (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2
                    is_far = is_far and away >= reach**2
                if not is_far:
                    break
            crossed = at_row[first_wall[r] : first_wall[r + 1]]
            if is_far and is_inside(walls, crossed, len(crossed), x, y):
                spots[n_spots, 0], spots[n_spots, 1] = x, y
                plane[n_spots] = _nearest_plane(points, plane_id, first, items, c, r, n_rows, x, y, step)
                n_spots += plane[n_spots] >= 0
    return n_spots


@inner_kernel
def _nearest_plane(points, plane_id, first, items, c, r, n_rows, x, y, step):  # type: ignore[no-untyped-def]
    """Return the row of the plane of the nearest point with one, searching cells from the middle outwards."""
    n_columns = (len(first) - 1) // n_rows
    nearest, found = np.inf, -1
    for ring in range(max(n_columns, n_rows)):
        if nearest <= ((ring - 0.5) * step) ** 2:
            break
        low, high = max(r - ring, 0), min(r + ring, n_rows - 1)
        for column in range(max(c - ring, 0), min(c + ring, n_columns - 1) + 1):
            # What lies within the ring is known; in the columns between only its ends are new.
            is_between = abs(column - c) < ring
            for row in range(low, high + 1, max(high - low, 1) if is_between else 1):
                if is_between and abs(row - r) < ring:
                    continue
                for m in range(first[column * n_rows + row], first[column * n_rows + row + 1]):
                    i = items[m]
                    away = (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2
                    if plane_id[i] > 0 and away < nearest:
                        nearest, found = away, np.int64(plane_id[i]) - 1
    return found


@inner_kernel
def _walls_at_rows(walls, step, row, n_rows):  # type: ignore[no-untyped-def]
    """Return which walls the middles of a raster's rows meet: where each row begins in them, and these."""
    first, items = np.zeros(n_rows + 1, np.int64), np.empty(0, np.int64)
    for turn in range(2):
        if turn == 1:
            for r in range(n_rows):
                first[r + 1] += first[r]
            items = np.empty(first[-1], np.int64)
        for k in range(len(walls)):
            low, high = min(walls[k, 1], walls[k, 3]), max(walls[k, 1], walls[k, 3])
            # By rounding it may be one more on either side.
            r0 = max(math.floor(low / step - 0.5) - row, 0)
            r1 = min(math.ceil(high / step - 0.5) - row, n_rows - 1)
            for r in range(r0, r1 + 1):
                if turn == 0:
                    first[r] += 1
                else:
                    first[r] -= 1
                    items[first[r]] = k
    return first, items
