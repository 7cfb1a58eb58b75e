"""The points of one building with their neighbours, and the plane of the smoothest piece around each."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.neighbours.cell_grid import CELLS_A_BLOCK, CellGrid, sort_by_cell
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.surfaces.plane_geometry import distance_of, fitted_plane
from lidar_buildings.core.surfaces.point_moments import N_MOMENTS

#: Neighbours kept of a point; of more, as many are taken evenly.
MAX_NEIGHBOURS = 24
#: Share of the connection radius that a point's own plane is taken from: little, to blur ridges little.
OWN_SHARE = 0.75
#: Fewest neighbours that a point's own plane is taken from; where fewer are that near, all are taken.
_FEWEST = 8
#: By what part of themselves heights count where few points are near, and how upright the normals of what is
#: found so may be: planes of 60° and more.
FLATTENING, STEEP_UPRIGHT = 0.125, 0.5
#: Surroundings no rougher than this times the noise hold no ridge: their point keeps their normal.
_SMOOTH = 1.3
#: A point may take the plane of surroundings that it lies no farther from than this times the noise.
_ON_PLANE = 3.0
#: The noise is the roughness that this share of all surroundings does not reach: the others hold ridges.
_NOISE_QUANTILE = 0.35
#: The noise is never taken to be less, nor more: that is a tree's roughness, or a heap of small planes' [m].
NOISE_RANGE = (0.005, 0.2)


class Cloud(NamedTuple):
    """The points of one building with what the search needs to know of them."""

    points: FloatArray
    normals: FloatArray
    #: Whether the surroundings hold no ridge and no step.
    is_smooth: BoolArray
    #: Rows of near points within the connection radius, first those that there are, then −1.
    neighbours: NDArray[np.int32]


class Survey(NamedTuple):
    """A cloud of distinct points, where they came from, and how noisy it is."""

    cloud: Cloud
    #: Row of the distinct point that stands for each given one.
    row_of: IntArray
    #: Standard deviation of points about the surface [m].
    noise: float


def survey_points(points: FloatArray, radius: float) -> Survey:
    """
    Sort distinct points, list the neighbours of each, estimate the noise and find the normals.

    Points closer than `radius` [m] are connected.
    """
    grid, row_of = distinct_grid(points, radius)
    distinct, runs = grid.points, grid.first[grid.around(radius)]
    neighbours = np.full((len(distinct), MAX_NEIGHBOURS), -1, dtype=np.int32)
    planes, roughness = np.empty((len(distinct), 4)), np.empty(len(distinct))
    for_row_blocks(
        lambda a, b: _look_around(grid, runs, radius, neighbours, planes, roughness, a, b),
        len(grid.first) - 1,
        CELLS_A_BLOCK,
    )
    noise = _noise_of(roughness)
    is_smooth = roughness <= (_SMOOTH * noise) ** 2
    normals = np.empty_like(distinct)
    for_row_blocks(
        lambda a, b: _take_smoothest(
            distinct, neighbours, planes, roughness, is_smooth, noise, normals, a, b
        ),
        len(distinct),
    )
    return Survey(Cloud(distinct, normals, is_smooth, neighbours), row_of, noise)


def distinct_grid(points: FloatArray, size: float) -> tuple[CellGrid, IntArray]:
    """
    Sort the distinct points into columns of a size [m]; return each given point's row among them, too.

    The grid's own rows are of no use.
    """
    grid = sort_by_cell(points, size)
    is_new = np.ones(len(points), dtype=bool)
    is_new[1:] = (grid.points[1:] != grid.points[:-1]).any(axis=1)
    row_of = np.empty(len(points), dtype=np.int64)
    row_of[grid.rows] = np.cumsum(is_new) - 1
    # Sorted points stay in their order.
    return (grid if is_new.all() else sort_by_cell(grid.points[is_new], size)), row_of


def _noise_of(roughness: FloatArray) -> float:
    known = roughness[np.isfinite(roughness)]
    if not len(known):
        return NOISE_RANGE[0]
    at = int(_NOISE_QUANTILE * len(known))
    return min(max(math.sqrt(np.partition(known, at)[at]), NOISE_RANGE[0]), NOISE_RANGE[1])


@kernel
def _look_around(grid, runs, radius, neighbours, planes, roughness, begin, end):  # type: ignore[no-untyped-def]
    """Fill in the neighbours, evenly thinned, and own planes of the points in cells begin to end."""
    most = 0
    for c in range(begin, end):
        most = max(most, (runs[c, :, 1] - runs[c, :, 0]).sum())
    rows, xyz = np.empty(most, np.int32), np.empty((most, 3))
    near, steep = np.empty(most + 1, np.int32), np.empty(most + 1, np.int32)
    moments, plane = np.empty(N_MOMENTS), np.zeros(4)
    for c in range(begin, end):
        around = _gather(grid.points, runs[c], rows, xyz)
        for i in range(grid.first[c], grid.first[c + 1]):
            x, y, z = grid.points[i]
            found = _within(xyz[:around], x, y, z, radius, 1.0, near)
            if _sum_near(xyz, near[:found], x, y, z, OWN_SHARE * radius, 1.0, moments) < _FEWEST:
                _sum_near(xyz, near[:found], x, y, z, radius, 1.0, moments)
            planes[i] = 0.0
            roughness[i] = _fit(moments, planes[i])
            if found <= _FEWEST:
                # On a steep roof those next to one another in plan are far apart.
                n = _within(xyz[:around], x, y, z, radius, FLATTENING, steep)
                _sum_near(xyz, steep[:n], x, y, z, radius, FLATTENING, moments)
                rough = _fit(moments, plane) if n > _FEWEST else np.inf
                if rough <= NOISE_RANGE[1] ** 2 and abs(plane[2]) < STEEP_UPRIGHT:
                    planes[i], roughness[i], found = plane, rough, n
                    near[:n] = steep[:n]
            planes[i, 3] -= planes[i, 0] * x + planes[i, 1] * y + planes[i, 2] * z
            n, kept = 0, min(found, MAX_NEIGHBOURS)
            for k in range(kept):
                j = rows[near[k * found // kept]]
                if j != i:
                    neighbours[i, n] = j
                    n += 1


@inner_kernel
def _fit(moments, plane):  # type: ignore[no-untyped-def]
    """Write the plane of sums and return the variance about it, infinite where there is none."""
    residual = fitted_plane(moments, plane) if moments[0] > 3.0 else -1.0
    return residual / (moments[0] - 3.0) if residual >= 0.0 else np.inf


@kernel
def _gather(points, runs, rows, xyz):  # type: ignore[no-untyped-def]
    """Put the points of runs side by side; return how many."""
    n = 0
    for row in range(len(runs)):
        for j in range(runs[row, 0], runs[row, 1]):
            rows[n] = j
            xyz[n, 0], xyz[n, 1], xyz[n, 2] = points[j, 0], points[j, 1], points[j, 2]
            n += 1
    return n


@kernel
def _within(xyz, x, y, z, radius, flat, near):  # type: ignore[no-untyped-def]
    """Write which points lie within a radius of a position to `near`; return how many."""
    n = 0
    for k in range(len(xyz)):
        dx, dy, dz = xyz[k, 0] - x, xyz[k, 1] - y, flat * (xyz[k, 2] - z)
        near[n] = k
        n += dx * dx + dy * dy + dz * dz <= radius * radius
    return n


@kernel
def _sum_near(xyz, near, x, y, z, radius, flat, moments):  # type: ignore[no-untyped-def]
    """Sum the near points within a radius of a position about it; return how many."""
    n, sx, sy, sz = 0.0, 0.0, 0.0, 0.0
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in near:
        dx, dy, dz = xyz[j, 0] - x, xyz[j, 1] - y, xyz[j, 2] - z
        # A factor instead of a branch: half of the points are within, in no order.
        inside = 1.0 if dx * dx + dy * dy + flat * flat * dz * dz <= radius * radius else 0.0
        wx, wy, wz = inside * dx, inside * dy, inside * dz
        n, sx, sy, sz = n + inside, sx + wx, sy + wy, sz + wz
        xx, xy, xz = xx + wx * dx, xy + wx * dy, xz + wx * dz
        yy, yz, zz = yy + wy * dy, yz + wy * dz, zz + wz * dz
    moments[0], moments[1], moments[2], moments[3] = n, sx, sy, sz
    moments[4], moments[5], moments[6], moments[7], moments[8], moments[9] = xx, xy, xz, yy, yz, zz
    return n


@kernel
def _take_smoothest(points, neighbours, planes, roughness, is_smooth, noise, normals, begin, end):  # type: ignore[no-untyped-def]
    """Give points begin to end the normal of the smoothest surroundings on whose plane they lie."""
    for i in range(begin, end):
        best = i
        if not is_smooth[i]:
            for j in neighbours[i]:
                if j < 0:
                    break
                if roughness[j] < roughness[best] and distance_of(planes[j], points, i) <= _ON_PLANE * noise:
                    best = j
        normals[i, 0], normals[i, 1], normals[i, 2] = planes[best, 0], planes[best, 1], planes[best, 2]
