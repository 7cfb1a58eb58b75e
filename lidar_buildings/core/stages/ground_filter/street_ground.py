"""
Ground that a scanner on the street has seen.

From above, the lowest point of a cell is ground unless something wide covers it. From the street it is where
the line of sight ends: the side of a car, a hedge, the part of a wall above the car that hides its foot. So
other questions are asked: does anything stand on it, can one walk to it, does lower ground lie near?
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import CellGrid, lowest_of_cells, rows_by_cell
from lidar_buildings.core.neighbours.union_find import flatten, link
from lidar_buildings.core.stages.ground_filter.error_layers import terrain_gradient
from lidar_buildings.core.surfaces.triangulation import triangulate

# Lengths in metres. Chosen with `bench.ground.street`, seeds 0 to 3.
#: Points up to so much above the lowest of a quarter of a cell are one layer,
LAYER = 0.2
#: and something stands on it if a point lies between these heights above the lowest.
STANDS = 0.3, 1.3
#: Beside the terrain's own slope: a step that one walks over, a kerb, and the rise over run beyond it.
STEP, SLOPE = 0.12, 0.15
#: Longer ways rise no further than this one.
LONGEST_LINK = 3.0
#: Parts of so many quarters of cells, 50 m² if they are of 1 m, are ground; cars and lorries have less.
LARGE_PART = 200
#: Smaller parts, of so many at least, join ground that lies at most this far from them at their level,
SMALL_PART, LONGEST_GAP, GAP_SLOPE = 4, 6.0, 0.1
#: and this often those join that they have led to.
ROUNDS = 6
#: No ground rises above other ground so near by more than a step and the share of the way.
REACH, RAISED_STEP, RAISED_SLOPE = 4.0, 0.15, 0.1
#: Height of the bins in which points of ground and of what stands on it are counted: at least, and in
#: standard deviations of the ground, which so many of the points below the terrain tell,
MIN_BIN, DEVIATIONS, SAMPLE = 0.03, 3.0, 100_000
#: over which height above the tolerance the latter are counted alone, and how many times as many have to be
#: in a bin of ground.
COUNTED, MAJORITY = 0.4, 2.0


def street_terrain(cloud: CellGrid, seen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """
    Return places on the ground that was seen from the street [m], shape (n, 3), one at least.

    Each quarter of a cell of `cloud` on which nothing stands has one candidate, the mean of its lowest layer.
    Neighbours in their triangulation that one may walk between make up a part. Large parts are ground, and
    small ones at its level, across what hides the ground between. Then goes what rises above lower ground
    within reach (Vosselman 2000), such as hedges that a part has climbed. All of this is measured from the
    terrain's slope, as quarter quantiles of blocks show it. `seen` are the points that count, one at least.
    """
    candidates, is_lowest = _bare_quarters(cloud.points, cloud.first, seen, cloud.size)
    if len(candidates) < 2:
        return cloud.points[lowest_of_cells(cloud, seen)]
    gradient = terrain_gradient(candidates, cloud.size)
    mesh = triangulate(candidates)
    part = _parts(mesh.vertices, mesh.triangles, gradient)
    size = np.bincount(part, minlength=len(part))
    ground = (size >= min(LARGE_PART, size.max()))[part]
    for _ in range(ROUNDS):
        waiting = np.flatnonzero(~ground & (size >= SMALL_PART)[part])
        if not len(waiting):
            break
        far, nearest = cKDTree(candidates[ground, :2]).query(candidates[waiting, :2])
        way = candidates[waiting] - candidates[ground][nearest]
        rise = way[:, 2] - np.einsum("ij,ij->i", gradient[waiting], way[:, :2])
        is_level = np.abs(rise) <= STEP + GAP_SLOPE * np.minimum(far, LONGEST_GAP)
        joins = 2 * np.bincount(part[waiting], is_level, len(part)) > size
        if not joins.any():
            break
        ground |= joins[part]
    rows = np.flatnonzero(ground)
    cells = rows_by_cell(candidates[rows], 0.5 * REACH)
    rows = rows[cells.rows]
    others = cells.select(is_lowest[rows])
    runs = others.first[cells.around(REACH)]
    raised = _above_others(cells.points, gradient[rows], cells.first, others.points, runs)
    return candidates[rows[~raised]]


@kernel
def _quarter(point, size):  # type: ignore[no-untyped-def]
    """Return in which quarter of its cell a point lies, 0 to 3."""
    east, north = point[0] / size, point[1] / size
    return int(east - math.floor(east) >= 0.5) + 2 * int(north - math.floor(north) >= 0.5)


@kernel
def _bare_quarters(points, first, seen, size):  # type: ignore[no-untyped-def]
    """Return the quarters' candidates, and which is the lowest of its cell; points rise within cells."""
    found, is_lowest = np.empty((4 * (len(first) - 1), 3)), np.zeros(4 * (len(first) - 1), dtype=np.bool_)
    n_found, low, is_bare, sums = 0, np.empty(4), np.empty(4, dtype=np.bool_), np.empty((4, 4))
    for k in range(len(first) - 1):
        low[:], is_bare[:], sums[:] = np.inf, True, 0.0
        for i in range(first[k], first[k + 1]):
            if not seen[i]:
                continue
            q, z = _quarter(points[i], size), points[i, 2]
            low[q] = min(low[q], z)
            if z <= low[q] + LAYER:
                sums[q, 0] += 1.0
                sums[q, 1] += points[i, 0]
                sums[q, 2] += points[i, 1]
                sums[q, 3] += z - low[q]
            elif STANDS[0] < z - low[q] < STANDS[1]:
                is_bare[q] = False
        lowest = -1
        for q in range(4):
            if low[q] < np.inf and is_bare[q]:
                found[n_found, 0], found[n_found, 1] = sums[q, 1] / sums[q, 0], sums[q, 2] / sums[q, 0]
                found[n_found, 2] = low[q] + sums[q, 3] / sums[q, 0]
                if lowest < 0 or found[n_found, 2] < found[lowest, 2]:
                    lowest = n_found
                n_found += 1
        if lowest >= 0:
            is_lowest[lowest] = True
    return found[:n_found], is_lowest[:n_found]


@kernel
def _parts(vertices, triangles, gradient):  # type: ignore[no-untyped-def]
    """Return the part of each candidate: the lowest row of those that it is connected with."""
    part = np.arange(len(gradient))
    for t in range(len(triangles)):
        for k in range(3):
            a, b = triangles[t, k], triangles[t, (k + 1) % 3]
            if a >= len(gradient) or b >= len(gradient):  # of the frame
                continue
            dx, dy = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1]
            east, north = gradient[a, 0] + gradient[b, 0], gradient[a, 1] + gradient[b, 1]
            rise = vertices[b, 2] - vertices[a, 2] - 0.5 * (dx * east + dy * north)
            if abs(rise) <= STEP + SLOPE * min(math.hypot(dx, dy), LONGEST_LINK):
                link(part, a, b)
    flatten(part)
    return part


@kernel
def _above_others(points, gradient, first, others, runs):  # type: ignore[no-untyped-def]
    """Mark points that rise above one of the others within reach, whose runs are given cell by cell."""
    found = np.zeros(len(points), dtype=np.bool_)
    for k in range(len(first) - 1):
        for i in range(first[k], first[k + 1]):
            for row in range(runs.shape[1]):
                for j in range(runs[k, row, 0], runs[k, row, 1]):
                    dx, dy = points[i, 0] - others[j, 0], points[i, 1] - others[j, 1]
                    rise = points[i, 2] - others[j, 2] - gradient[i, 0] * dx - gradient[i, 1] * dy
                    if rise > RAISED_STEP:
                        far = math.hypot(dx, dy)
                        found[i] = found[i] or (far <= REACH and rise > RAISED_STEP + RAISED_SLOPE * far)
    return found


def street_ground(
    cells: CellGrid, seen: NDArray[np.bool_], height: NDArray[np.float64], tolerance: float
) -> NDArray[np.bool_]:
    """
    Return which of the points seen are ground: those near the terrain, but for the feet of what stands there.

    `height` is above the terrain, at most the `tolerance` up or down is near it [m]. What stands in a quarter
    of a cell has points at all heights. So as many as above the tolerance are taken for its own below, and
    ground ends where others are no majority. Others than the points seen are none.
    """
    ground = seen & (np.abs(height) <= tolerance)
    below = height[ground & (height <= 0.0)]  # nothing stands there
    deviation = -1.4826 * float(np.median(below[:: 1 + len(below) // SAMPLE])) if len(below) else 0.0
    n_bins = int(tolerance / max(DEVIATIONS * deviation, MIN_BIN)) or 1
    _leave_out_feet(cells.points, cells.first, seen, cells.size, height, (tolerance, n_bins), ground)
    return ground


@kernel
def _leave_out_feet(points, first, seen, size, height, bins, ground):  # type: ignore[no-untyped-def]
    """Clear what is no majority in its bin, and above such bins; `bins` are up to which height, how many."""
    tolerance, n_bins = bins
    side = tolerance / n_bins
    count, n_standing, top = np.empty((4, n_bins)), np.empty(4), np.empty(4)
    for k in range(len(first) - 1):
        count[:], n_standing[:], top[:] = 0.0, 0.0, tolerance
        for i in range(first[k], first[k + 1]):
            if seen[i] and 0.0 <= height[i] < tolerance + COUNTED:
                q = _quarter(points[i], size)
                if height[i] <= tolerance:
                    count[q, min(int(height[i] / side), n_bins - 1)] += 1.0
                else:
                    n_standing[q] += 1.0
        for q in range(4):
            for b in range(n_bins - 1, 0, -1):
                if count[q, b] < MAJORITY * n_standing[q] * side / COUNTED:
                    top[q] = b * side
        for i in range(first[k], first[k + 1]):
            ground[i] = ground[i] and height[i] <= top[_quarter(points[i], size)]
