"""Points joined to their neighbours: wherever the surface goes on smoothly, or they lie near."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.cell_grid import CellGrid, rows_by_cell, sort_by_cell
from lidar_buildings.core.neighbours.union_find import flatten, link, numbered, root

#: CellGrid a step: points in one of half a step's side are all connected in plan.
COLUMNS_A_STEP = 2.0
#: What is farther apart than this is never of one block, and no neighbourhood reaches across: half of a
#: window of the segmentation across lines as far apart as lines can be [spacings].
APART_SPACINGS = 15.0


def smooth_patches(
    columns: CellGrid,
    normals: NDArray[np.float64],
    reach: NDArray[np.float64],
    *,
    max_angle_deg: float,
    max_offset: float,
) -> NDArray[np.int64]:
    """
    Number the patches of points that are linked by smooth steps; every point is in one, if only its own.

    Two points within the reach of either are linked if their normals differ by no more than an angle and each
    lies within `max_offset` of the other's tangent plane; a patch is whatever links connect (smoothness
    constraint of Rabbani and others, 2006, without its seeds: the result does not depend on where growing
    starts).
    """
    parent = np.arange(len(columns.points))
    limits = (math.cos(math.radians(max_angle_deg)), max_offset)
    least = float(reach.min(initial=np.inf))
    # Most links are short as a rule, and found in fewer columns.
    for chosen in (reach == least, reach > least):
        if chosen.any():
            asking = columns.holding(chosen)
            runs = columns.around(float(reach[chosen].max()), asking)
            _link_smooth(columns.points, columns.first, asking, runs, normals, chosen, reach, *limits, parent)
    flatten(parent)
    return numbered(parent)


def connected_parts(
    points: NDArray[np.float64], radius: float, *, in_plan: bool = False
) -> NDArray[np.int64]:
    """Number the parts of a cloud that are connected by steps no longer than a radius [m]."""
    # In plan all of a column is of one part, in whatever order.
    columns = (rows_by_cell if in_plan else sort_by_cell)(points, radius / COLUMNS_A_STEP)
    part = np.empty(len(points), dtype=np.int64)
    part[columns.rows] = connected_columns(columns, radius, in_plan=in_plan)
    return part


def connected_columns(columns: CellGrid, radius: float, *, in_plan: bool = False) -> NDArray[np.int64]:
    """
    Number the parts of points in columns that are connected by steps no longer than a radius [m].

    Points of a column that are within a radius of one another whatever their places are taken together, and
    pairs are looked at only until one connects two such groups: quick if columns are half a radius wide.
    """
    part = np.empty(len(columns.points), dtype=np.int64)
    held = np.flatnonzero(np.diff(columns.first))
    runs = (columns.around(reach, held, north=True) for reach in (columns.size, radius))
    _connect(columns.points, columns.first, held, *runs, radius, columns.size, in_plan, part)
    return part


def plan_areas(
    labels: NDArray[np.int64], n_labels: int, first: NDArray[np.int64], cell: float
) -> NDArray[np.float64]:
    """
    Return the area of the grid cells that the points of each label occupy [m²].

    Labels come cell by cell, −1 is none; cell k holds the points first[k] to first[k + 1] (exclusive).
    """
    counts = np.zeros(n_labels, dtype=np.int64)
    _count_cells(labels, first, counts)
    return counts.astype(np.float64) * cell**2


@kernel
def _count_cells(labels, first, counts):  # type: ignore[no-untyped-def]
    counted_last = np.full(len(counts), -1, dtype=np.int64)
    for k in range(len(first) - 1):
        for label in labels[first[k] : first[k + 1]]:
            if label >= 0 and counted_last[label] != k:
                counted_last[label] = k
                counts[label] += 1


@kernel
def _connect(points, first, held, beside, around, radius, size, in_plan, part):  # type: ignore[no-untyped-def]
    """Write the number of each point's part."""
    square = radius * radius
    height = math.sqrt(square - 2.0 * size * size) if square > 2.0 * size * size else -1.0
    start, group = np.empty(len(points) + 1, dtype=np.int64), np.empty(len(first), dtype=np.int64)
    n = 0
    for k in range(len(first) - 1):
        group[k] = n
        i = first[k]
        while i < first[k + 1]:
            start[n], lowest = i, points[i, 2]
            n, i = n + 1, i + 1
            while i < first[k + 1] and height >= 0.0 and (in_plan or points[i, 2] - lowest <= height):
                i += 1
    group[-1], start[n] = n, len(points)
    # What lies beside connects most of it; little remains to be measured farther away, past what is of a set.
    parent, beyond = np.arange(n), np.arange(1, n + 1)
    for runs in (beside, around):
        for place in range(len(held)):
            k = held[place]
            for one in range(group[k], group[k + 1]):
                own = root(parent, one)
                low, high = points[start[one], 2] - radius, points[start[one + 1] - 1, 2] + radius
                for row in range(runs.shape[1]):
                    west, east = group[runs[place, row, 0]], group[runs[place, row, 1]]
                    other = max(west, one + 1)
                    while other < east:
                        if parent[other] == own:
                            other = beyond[other]
                            continue
                        begin, end = start[other], start[other + 1]
                        is_level = in_plan or (points[begin, 2] <= high and points[end - 1, 2] >= low)
                        if (
                            is_level
                            and own != root(parent, other)
                            and _touch(points, start[one], start[one + 1], begin, end, square, in_plan)
                        ):
                            link(parent, own, other)
                            own = root(parent, own)
                        other += 1
        flatten(parent)
        for one in range(n - 2, -1, -1):
            if parent[one] == parent[one + 1]:
                beyond[one] = beyond[one + 1]
    number = 0
    for one in range(n):
        # The lowest of a set is its root, and has its number before the others.
        if parent[one] == one:
            parent[one] = number
            number += 1
        else:
            parent[one] = parent[parent[one]]
        part[start[one] : start[one + 1]] = parent[one]


@kernel
def _touch(points, begin, end, other_begin, other_end, square, in_plan):  # type: ignore[no-untyped-def]
    """Tell whether any point of one run is near any of another."""
    for i in range(begin, end):
        for j in range(other_begin, other_end):
            dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
            dz = 0.0 if in_plan else points[j, 2] - points[i, 2]
            if dx * dx + dy * dy + dz * dz <= square:
                return True
    return False


@kernel
def _link_smooth(points, first, asking, runs, normals, chosen, reach, min_cosine, max_offset, parent):  # type: ignore[no-untyped-def]
    """Link the chosen points to all others within their reach."""
    for one in range(len(asking)):
        k = asking[one]
        for i in range(first[k], first[k + 1]):
            if not chosen[i]:
                continue
            x, y, z = points[i]
            a, b, c = normals[i]
            own = root(parent, i)
            for row in range(runs.shape[1]):
                for j in range(first[runs[one, row, 0]], first[runs[one, row, 1]]):
                    # A chosen one before it that reaches back has found this link itself.
                    if parent[j] == own or (j < i and chosen[j] and reach[j] >= reach[i]):
                        continue
                    dx, dy, dz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
                    u, v, w = normals[j]
                    if (
                        dx * dx + dy * dy + dz * dz <= reach[i] * reach[i]
                        and abs(a * u + b * v + c * w) >= min_cosine
                        and abs(a * dx + b * dy + c * dz) <= max_offset
                        and abs(u * dx + v * dy + w * dz) <= max_offset
                    ):
                        link(parent, own, j)
                        own = root(parent, own)


def own_roofs(tile: PointTile) -> NDArray[np.bool_]:
    """
    Tell which points are roof and hang together with roof points of the tile's core.

    All that a tile says of its core points and of its own buildings, whose westernmost points are core
    points, depends on these alone. All roofs are its own if it has no buffer or its spacing is not known.
    """
    is_own = tile.is_roof
    if tile.buffer is None or tile.point_spacing is None:
        return is_own
    rows = np.flatnonzero(is_own)
    part = connected_parts(tile.points[rows], APART_SPACINGS * tile.point_spacing, in_plan=True)
    has_core = np.bincount(part, tile.is_core[rows]) > 0
    is_own[rows] = has_core[part]
    return is_own
