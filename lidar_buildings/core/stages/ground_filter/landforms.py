"""Landforms or objects: parts of what may be ground, judged by their links to the terrain."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.neighbours.cell_grid import in_rows_order, raster_cells, sort_by_cell
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.neighbours.union_find import flatten, link
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.surfaces.point_moments import N_MOMENTS, add_point, covariance

# These and the rules below were chosen with `bench.ground.isprs` and `bench.ground.scenes`.
#: How far neighbours may be, in spacings of the candidates, and how many count.
REACH, N_LINKS = 3.0, 8
#: Share of objects around up to which terrain is open, and from which on it is not at all.
OPEN_SHARE, BUILT_SHARE = 0.04, 0.15
#: Side of the cells that are counted [m], and the number of them around: `bench.ground.isprs` and `.scenes`.
CELL, RADIUS = 10.0, 6
#: Points of one part rise by no more than this over their distance in plan.
MAX_LINK_SLOPE = 0.7
#: A link is steep if it rises by more than this over its length: walls do, banks do not.
STEEP_SLOPE = 0.85
#: Smallest part that is judged as a whole, among objects and in open terrain [candidates].
MIN_PART, MIN_OPEN_PART = 15.0, 2.0
#: Parts with at least this share of steep links, of at least so many candidates, are excluded.
EXCLUDED_SHARE, MIN_EXCLUDED_PART = 0.7, 50.0


def find_landforms(
    candidates: NDArray[np.float64],
    ground: NDArray[np.bool_],
    gained: NDArray[np.bool_],
    spacing: float,
    config: GroundFilterConfig,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """
    Tell which of the gained candidates are of the terrain, and which are certainly not.

    Neighbours that are gained and nearly level make up a part. Its links to the ground decide: banks, mounds
    and terraces meet it under slopes, walls in steps (Sithole & Vosselman 2005 judge segments in this way).
    How many steps are allowed depends on the density of objects: in open terrain, what rises from it is
    likely to be terrain. Candidates, at most one a place, have shape (n, 3) and a mean `spacing` [m];
    `ground` is ground without doubt, `gained` what may be as well, bool of shape (n,). Both results are masks
    of candidates.
    """
    rows = np.flatnonzero(gained)
    links = nearest_candidates(candidates, rows, REACH * spacing)
    density = object_density(candidates, ~(ground | gained))[rows]
    openness = np.clip((BUILT_SHARE - density) / (BUILT_SHARE - OPEN_SHARE), 0.0, 1.0)
    part = level_parts(candidates, rows, links, MAX_LINK_SLOPE)
    counts = _count_links(candidates, rows, links, ground, part)
    kept, certain = _judge(counts, np.bincount(part, openness, len(rows)).astype(np.float64), config)
    landform, excluded = np.zeros_like(ground), np.zeros_like(ground)
    landform[rows] = kept[part]
    excluded[rows] = certain[part]
    return landform, excluded


def _judge(
    counts: NDArray[np.float64], openness: NDArray[np.float64], config: GroundFilterConfig
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    size, n_links, n_steep = counts.T
    is_open = openness / np.maximum(size, 1.0)
    allowed = config.max_steep_share + is_open * (config.max_open_steep_share - config.max_steep_share)
    large = size >= MIN_PART + is_open * (MIN_OPEN_PART - MIN_PART)
    kept = large & (n_links > 0.0) & (n_steep <= allowed * n_links)
    walled = n_steep >= EXCLUDED_SHARE * np.maximum(n_links, 1.0)
    return kept, ~kept & walled & (size >= MIN_EXCLUDED_PART)


@kernel
def _count_links(candidates, rows, links, ground, part):  # type: ignore[no-untyped-def]
    """Return each part's size, its links to the ground, and how many of them are steep."""
    counts = np.zeros((len(rows), 3))
    for r in range(len(rows)):
        count = counts[part[r]]
        count[0] += 1.0
        for j in links[r]:
            if j < 0 or not ground[j]:
                continue
            rise, length = rise_and_length(candidates[j], candidates[rows[r]])
            count[1] += 1.0
            count[2] += 1.0 if rise > STEEP_SLOPE * length else 0.0
    return counts


def object_density(candidates: NDArray[np.float64], is_object: NDArray[np.bool_]) -> NDArray[np.float64]:
    """
    Return the share of objects among the candidates around each, 0 to 1.

    Cells up to 60 m away along x and y count with Gaussian weights (σ = 30 m).
    """
    cell, shape = raster_cells(candidates, CELL)
    n_objects, n_all = (
        np.bincount(cell, weights, shape[0] * shape[1]).astype(np.float64).reshape(shape)
        for weights in (is_object, None)
    )
    near = [
        ndimage.gaussian_filter(one, RADIUS / 2.0, mode="constant", truncate=2.0).ravel()[cell]
        for one in (n_objects, n_all)
    ]
    return near[0] / near[1]


def nearest_candidates(
    candidates: NDArray[np.float64], rows: NDArray[np.intp], reach: float
) -> NDArray[np.int64]:
    """Return the nearest others of some candidates within reach in plan [m], −1 where there are fewer."""
    tree, nearest = cKDTree(candidates[:, :2]), [*range(2, N_LINKS + 2)]  # the first is itself
    near = tree.query(candidates[rows, :2], nearest, distance_upper_bound=reach)[1]
    return np.where(near < len(candidates), near, -1)


@kernel
def level_parts(candidates, rows, links, max_slope):  # type: ignore[no-untyped-def]
    """
    Return the part of each row: the lowest of the rows that it is connected with.

    Neighbours, the `links` of `nearest_candidates`, are connected if they rise by no more than `max_slope`
    over their distance.
    """
    place = np.full(len(candidates), -1, dtype=np.int32)
    part = np.empty(len(rows), dtype=np.int64)
    for r in range(len(rows)):
        place[rows[r]] = part[r] = r
    for r in range(len(rows)):
        for j in links[r]:
            if j < 0 or place[j] < 0:
                continue
            rise, length = rise_and_length(candidates[j], candidates[rows[r]])
            if abs(rise) <= max_slope * length:
                link(part, r, place[j])
    flatten(part)
    return part


@inner_kernel
def rise_and_length(start, end):  # type: ignore[no-untyped-def]
    """Return the rise from one point to another and their distance in plan [m]."""
    return end[2] - start[2], math.hypot(end[0] - start[0], end[1] - start[1])


# These and the rules below were chosen with `bench.ground.isprs` and `bench.ground.scenes`.
#: Directions of the half planes that are tried.
SIDES = np.array([(math.cos(turn), math.sin(turn)) for turn in 0.25 * math.pi * np.arange(8)])
#: How far the points of a plane may be, and how near the nearest of them has to be, in spacings.
PLANE_REACH, PLANE_NEAREST = 3.5, 2.0
#: Fewest points of a plane.
MIN_PLANE_POINTS = 6
#: Its steepest slope, rise over run, and its largest root mean square residual [m].
MAX_SLOPE, MAX_RESIDUAL = 0.8, 0.25
#: How far from it a point may be beyond that residual [m].
MAX_DISTANCE = 0.3
#: Least 4 λ₁ λ₂ / (λ₁ + λ₂)² of the points' moments in plan: 1 if they lie all round, 0 if on a line.
MIN_SPREAD = 0.05


def continues_terrain(
    candidates: NDArray[np.float64], rows: NDArray[np.intp], ground: NDArray[np.bool_], spacing: float
) -> NDArray[np.bool_]:
    """
    Return which of the rows lie on the plane through the ground in a half plane around them.

    A robust form of mirroring (Axelsson 2000): instead of one corner's far side, all ground on one side of
    the point has to make a plane that the point lies on. A roof has ground below it on every side.
    Candidates, ground and spacing are those of `find_landforms`; the rows are no ground.
    """
    reach, nearest = PLANE_REACH * spacing, PLANE_NEAREST * spacing
    cells = sort_by_cell(candidates, reach)
    cell, runs = in_rows_order(cells, cells.cell), cells.first[cells.around(reach)]
    around = cell, runs, cells.points, ground[cells.rows]
    found = np.zeros(len(rows), dtype=np.bool_)
    for_row_blocks(lambda a, b: _try_sides(candidates, rows, around, reach, nearest, found, a, b), len(rows))
    return found


@kernel
def _try_sides(candidates, rows, around, reach, nearest, found, begin, end):  # type: ignore[no-untyped-def]
    cell, runs, points, ground = around
    sums = np.empty((len(SIDES), N_MOMENTS + 1))  # of each side, and how near its nearest point is
    for r in range(begin, end):
        x, y, z = candidates[rows[r]]
        sums[:, :N_MOMENTS], sums[:, N_MOMENTS] = 0.0, np.inf
        for begins, ends in runs[cell[rows[r]]]:
            for i in range(begins, ends):
                dx, dy, dz = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
                away = math.hypot(dx, dy)
                if not ground[i] or away > reach:
                    continue
                for side in range(len(SIDES)):
                    if dx * SIDES[side, 0] + dy * SIDES[side, 1] > 1e-9:
                        add_point(sums[side], dx, dy, dz)
                        sums[side, N_MOMENTS] = min(sums[side, N_MOMENTS], away)
        for side in range(len(SIDES)):
            found[r] = found[r] or (sums[side, N_MOMENTS] <= nearest and _makes_plane(sums[side]))


@kernel
def _makes_plane(sums):  # type: ignore[no-untyped-def]
    """Whether points make a plane that passes near the candidate, which lies at the origin."""
    n = sums[0]
    xx, xy, xz, yy, yz, zz = covariance(sums)
    determinant = xx * yy - xy * xy
    if n < MIN_PLANE_POINTS or determinant <= MIN_SPREAD * 0.25 * (xx + yy) ** 2:
        return False
    a, b = (xz * yy - yz * xy) / determinant, (yz * xx - xz * xy) / determinant
    residual = math.sqrt(max(0.0, zz - a * xz - b * yz))
    off = abs(sums[3] - a * sums[1] - b * sums[2]) / n
    return math.hypot(a, b) <= MAX_SLOPE and residual <= MAX_RESIDUAL and off <= MAX_DISTANCE + residual
