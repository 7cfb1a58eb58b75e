"""How well each plane fits the points over each cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.model.array_types import FloatArray, IntArray

#: Spots farther than this from any point are without data [spacings].
EMPTY_DISTANCE = 2.0
#: Most spots of the raster.
_MAX_SPOTS = 40_000
#: A point counts as so far off its plane at most [m].
MAX_MISFIT = 1.0
#: Misfit of a plane that is not the nearest one's where there are no points [m].
_EMPTY_MISFIT = 0.2


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
    points: FloatArray, plane_id: NDArray[np.uint16], outline: shapely.Polygon, spacing: float
) -> Samples:
    """
    Weigh points by the area they stand for, and find the spots without any.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        Roof points [m].
    plane_id : ndarray of shape (n_points,)
        Number of each point's plane, 0 = none.
    outline : shapely.Polygon
        Of the building [m].
    spacing : float
        Point spacing [m].
    """
    shapely.prepare(outline)
    west, south, east, north = outline.bounds
    step = max(spacing, ((east - west) * (north - south) / _MAX_SPOTS) ** 0.5)
    # Whole multiples of the step, so that the raster does not hang on the outline.
    column, row = np.floor(west / step), np.floor(south / step)
    shape = int(np.floor(east / step) - column) + 1, int(np.floor(north / step) - row) + 1
    place = (np.floor(points[:, :2] / step) - (column, row)).astype(np.int64)
    inside = ((place >= 0) & (place < shape)).all(axis=1)
    flat = np.where(inside, place[:, 0] * shape[1] + place[:, 1], 0)
    count = np.bincount(flat[inside], minlength=shape[0] * shape[1])
    weight = np.where(inside, step**2 / np.maximum(count[flat], 1), step**2)
    empty = np.flatnonzero(count == 0)
    spots = (np.column_stack([empty // shape[1] + column, empty % shape[1] + row]) + 0.5) * step
    spots = spots[shapely.contains_xy(outline, spots)]
    planar = np.flatnonzero(plane_id > 0)
    if not len(spots) or not len(planar):
        return Samples(points, weight, np.full(len(points), -1, dtype=np.int64))
    tree = cKDTree(points[:, :2])
    far = np.isinf(tree.query(spots, distance_upper_bound=EMPTY_DISTANCE * spacing)[0])
    spots = spots[far]
    nearest = cKDTree(points[planar, :2]).query(spots)[1] if len(spots) else np.zeros(0, dtype=np.int64)
    label = plane_id[planar].astype(np.int64)[nearest] - 1
    return Samples(
        np.concatenate([points, np.column_stack([spots, np.zeros(len(spots))])]),
        np.concatenate([weight, np.full(len(spots), step**2)]),
        np.concatenate([np.full(len(points), -1, dtype=np.int64), label]),
    )


@njit(cache=True, nogil=True)
def cells_of_samples(
    x: FloatArray,
    y: FloatArray,
    order: IntArray,
    corners: FloatArray,
    first: IntArray,
    owner: IntArray,
    n_cells: int,
) -> IntArray:
    """
    Return the cell that each place lies in, -1 for none.

    Parameters
    ----------
    x, y : ndarray of shape (n_places,)
        In the order of rising x [m].
    order : ndarray of shape (n_places,), int64
        Row to write to for each.
    corners : ndarray of shape (n_corners, 2)
        Of all rings, each closed by its first corner [m].
    first : ndarray of shape (n_rings + 1,), int64
        Where each ring begins among the corners.
    owner : ndarray of shape (n_rings,), int64
        Cell of each ring, rising.
    n_cells : int
    """
    found = np.full(len(x), -1, np.int64)
    crossings = np.zeros(len(x), np.uint8)
    ring = 0
    for cell in range(n_cells):
        last = ring
        while last < len(owner) and owner[last] == cell:
            last += 1
        low, high = corners[first[ring] : first[last], 0].min(), corners[first[ring] : first[last], 0].max()
        start, stop = np.searchsorted(x, low), np.searchsorted(x, high, side="right")
        crossings[start:stop] = 0
        for r in range(ring, last):
            for k in range(first[r], first[r + 1] - 1):
                ax, ay = corners[k]
                bx, by = corners[k + 1]
                if ax == bx:
                    continue
                left, right = min(ax, bx), max(ax, bx)
                begin, end = np.searchsorted(x, left), np.searchsorted(x, right)
                slope = (by - ay) / (bx - ax)
                for i in range(begin, end):
                    if y[i] < ay + slope * (x[i] - ax):
                        crossings[i] ^= 1
        for i in range(start, stop):
            if crossings[i]:
                found[order[i]] = cell
        ring = last
    return found


@njit(cache=True, nogil=True)
def sum_misfits(
    points: FloatArray,
    weight: FloatArray,
    nearest: IntArray,
    cell: IntArray,
    planes: FloatArray,
    n_cells: int,
) -> FloatArray:
    """
    Return the misfit [m³] of every plane over every cell, shape (n_cells, n_planes).

    Distances are vertical and count no more than `MAX_MISFIT`, so that chimneys and antennas pull on no
    plane; spots without data speak for the nearest plane.
    """
    costs = np.zeros((n_cells, len(planes)))
    for i in range(len(points)):
        c = cell[i]
        if c < 0:
            continue
        for k in range(len(planes)):
            if nearest[i] >= 0:
                misfit = 0.0 if nearest[i] == k else _EMPTY_MISFIT
            else:
                z = planes[k, 0] * points[i, 0] + planes[k, 1] * points[i, 1] + planes[k, 2]
                misfit = min(abs(points[i, 2] - z), MAX_MISFIT)
            costs[c, k] += weight[i] * misfit
    return costs
