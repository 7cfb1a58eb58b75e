"""Buildings that touch at different heights, split at the step edges between them."""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.neighbours.cell_grid import rows_by_cell, sort_by_cell
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.neighbours.union_find import flatten, link
from lidar_buildings.core.stages.segmentation.windows import occupied_areas
from lidar_buildings.core.surfaces.plane_geometry import fitted_plane
from lidar_buildings.core.surfaces.point_moments import N_MOMENTS, add_point

#: A part with less than this share of its perimeter in the open stands on another roof, and is a building of
#: its own, not a penthouse or plant room, from this area on [m²].
MIN_FREE_SHARE, MIN_TOWER_AREA = 0.1, 100.0
#: A perimeter counted in cell sides is longer than the line itself by 4/π, on average over directions.
STAIRS = 1.27
#: Radius within which planes are fitted and neighbours linked [spacings].
REACH = 2.25
#: Fewest neighbours that a plane is fitted to.
MIN_NEIGHBOURS = 6
#: Vertical component of a normal below which a plane is a wall.
MIN_UPRIGHT = 0.1
#: A plane is some point's if it passes it within this share of the least step.
MAX_OFFSET = 0.25
#: Cells in which borders are measured [spacings]: hardly one of them is empty amid a roof.
BORDER_CELL = 2.0
#: Least width of a part, from its area and perimeter and from how its points scatter: dormers and ledges go
#: back to their buildings [m].
MIN_PART_WIDTH = 2.5
#: Points a block of work.
BLOCK = 2048


def plan_sums(points: NDArray[np.float64], part: NDArray[np.int64], n_parts: int) -> NDArray[np.float64]:
    """
    Return the number of points and the sums of x, y, x², y² and xy of every part, shape (n_parts, 6).

    Coordinates are taken from the middle of all points, in which squares keep their digits.
    """
    if not len(points):
        return np.zeros((n_parts, 6))
    x, y = (points[:, :2] - extent_of(points[:, :2]).sum(axis=0) / 2.0).T
    terms = (np.ones(len(x)), x, y, x * x, y * y, x * y)
    return np.column_stack([np.bincount(part, weights=term, minlength=n_parts) for term in terms])


def spread_width(sums: NDArray[np.float64]) -> float:
    """
    Return the width of the rectangle with the least scatter of a part's points [m].

    Points spread evenly over a width w scatter by w/√12. Bent parts, whose points scatter more, come out
    wider than they are.
    """
    n, x, y, xx, yy, xy = sums.tolist()
    if n < 1.0:
        return 0.0
    xx, yy, xy = xx / n - (x / n) ** 2, yy / n - (y / n) ** 2, xy / n - x * y / n**2
    least = (xx + yy) / 2.0 - math.hypot((xx - yy) / 2.0, xy)
    return math.sqrt(12.0 * max(least, 0.0))


def rectangle_width(area: float, perimeter: float) -> float:
    """Return the shorter side of the rectangle of an area and perimeter, or of the square if none."""
    half = perimeter / 2.0
    root = half * half - 4.0 * area
    return (half - math.sqrt(root)) / 2.0 if root > 0.0 else math.sqrt(area)


class Borders(NamedTuple):
    """Lengths of borders."""

    free: NDArray[np.float64]  #: perimeter in the open [m], shape (n_parts,)
    shared: dict[tuple[int, int], float]  #: (part, other part) → length of their border [m], both ways round


def measure_borders(
    points: NDArray[np.float64], part: NDArray[np.int64], n_parts: int, cell: float
) -> Borders:
    """
    Measure the borders of parts from the cells that they occupy.

    A cell, counted from (0, 0), belongs to the part with most points in it. A side between two parts' cells
    is on their border, one beside two empty cells is in the open; a single empty one is a gap between points.
    A part that owns no cell borders on the owners of the cells that it has points in.
    """
    cells = rows_by_cell(points, cell)
    numbers, n_columns, open_side = cells.numbers, cells.n_columns, n_parts
    cell_of = np.repeat(np.arange(len(numbers)), np.diff(cells.first))
    held, n_points = np.unique(cell_of * n_parts + part[cells.rows], return_counts=True)
    held_in, holder = np.divmod(held, n_parts)
    order = np.lexsort((holder, n_points, held_in))
    owner = holder[order][np.flatnonzero(np.diff(held_in[order], append=-1))]
    one, other = [], []
    for right, up in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        beside = np.full(len(numbers), open_side)
        for far in (2, 1):
            column = numbers % n_columns + far * right
            wanted = numbers + far * (right + up * n_columns)
            found = np.minimum(np.searchsorted(numbers, wanted), len(numbers) - 1)
            is_there = (numbers[found] == wanted) & (column >= 0) & (column < n_columns)
            beside[is_there] = owner[found[is_there]]
        one.append(owner)
        other.append(beside)
    amid = ~np.isin(holder, owner)
    one += [holder[amid], owner[held_in[amid]]]
    other += [owner[held_in[amid]], holder[amid]]
    first, second = np.concatenate(one), np.concatenate(other)
    is_border = first != second
    pairs, n_sides = np.unique((first * (n_parts + 1) + second)[is_border], return_counts=True)
    length = n_sides.astype(np.float64) * (cells.size / STAIRS)
    first, second = np.divmod(pairs, n_parts + 1)
    is_free = second == open_side
    free = np.bincount(first[is_free], weights=length[is_free], minlength=n_parts).astype(np.float64)
    shared = zip(first[~is_free].tolist(), second[~is_free].tolist(), strict=True)
    return Borders(free, dict(zip(shared, length[~is_free].tolist(), strict=True)))


def merge_parts(
    borders: Borders,
    area: NDArray[np.float64],
    sums: NDArray[np.float64],
    block: NDArray[np.int64],
    *,
    min_area: float,
    min_width: float,
) -> NDArray[np.int64]:
    """
    Return into which part each part goes, the smallest first; a part that stays goes into itself.

    A part goes if it is smaller or narrower (the rectangle of its area and perimeter, and the scatter of its
    points, whose `plan_sums` are given) than a building, or than a tower if nearly all of its rim is
    another's. It goes to the part of its block with which it shares the longest border, and where there is
    none to the largest.
    """
    size, free, sums, into = area.tolist(), borders.free.tolist(), sums.copy(), np.arange(len(area))
    shared: list[dict[int, float]] = [{} for _ in size]
    for (one, other), length in sorted(borders.shared.items()):
        if block[one] == block[other]:
            shared[one][other] = length
        else:
            free[one] += length
    waiting = [(one, number) for number, one in enumerate(size)]
    heapq.heapify(waiting)
    while waiting:
        least, number = heapq.heappop(waiting)
        if into[number] != number or least != size[number]:
            continue
        rim = free[number] + sum(shared[number].values())
        is_tower = free[number] < MIN_FREE_SHARE * rim
        if (
            least >= (max(min_area, MIN_TOWER_AREA) if is_tower else min_area)
            and min(rectangle_width(least, rim), spread_width(sums[number])) >= min_width
        ):
            continue
        alike = np.flatnonzero((block == block[number]) & (into == np.arange(len(into))))
        others = shared[number] or {other: 0.0 for other in alike.tolist() if other != number}
        if not others:
            continue
        target = max(others, key=lambda other: (others[other], size[other], -other))
        into[number] = target
        size[target], free[target] = size[target] + least, free[target] + free[number]
        sums[target] += sums[number]
        for other, length in shared[number].items():
            del shared[other][number]
            if other != target:
                shared[target][other] = shared[other][target] = shared[target].get(other, 0.0) + length
        heapq.heappush(waiting, (size[target], target))
    while (into[into] != into).any():
        into = into[into]
    return into


def split_blocks(
    points: NDArray[np.float64],
    block: NDArray[np.int64],
    n_blocks: int,
    spacing: float,
    *,
    min_step_height: float,
    min_area: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Number the parts of blocks that steps in height part from each other.

    Every point takes the slope of the plane near it that fits best, which at a step is one that lies on its
    own side. Neighbours are linked if, that slope taken off, their heights differ by less than the least
    step, and what links connect is a part. Points that are on no plane, as those of walls, link nothing and
    belong where the nearest point on one does. Parts too small, too narrow or nearly enclosed by another go
    back to the one with which they share the longest border, the smallest first. Points are (n_points, 3) in
    any order [m]; `block` counts from 0, −1 is none; `spacing` is 1/√density [m]. Returned are the part of
    each point, −1 where there is no block, and the block of every part, int64.
    """
    rows = np.flatnonzero(block >= 0)
    some, of_block = points[rows], block[rows]
    linked = _linked_parts(some, of_block, REACH * spacing, min_step_height)
    n_linked = int(linked.max(initial=-1)) + 1
    block_of_linked = np.zeros(n_linked, dtype=np.int64)
    block_of_linked[linked] = of_block
    if n_linked > n_blocks:
        area = occupied_areas(some, linked, n_linked, spacing)
        borders = measure_borders(some, linked, n_linked, BORDER_CELL * spacing)
        sums = plan_sums(some, linked, n_linked)
        into = merge_parts(borders, area, sums, block_of_linked, min_area=min_area, min_width=MIN_PART_WIDTH)
        kept, linked = np.unique(into[linked], return_inverse=True)
        block_of_linked = block_of_linked[kept]
    part = np.full(len(points), -1, dtype=np.int64)
    part[rows] = linked
    return part, block_of_linked


def _linked_parts(
    points: NDArray[np.float64], block: NDArray[np.int64], reach: float, min_step: float
) -> NDArray[np.int64]:
    grid, n = sort_by_cell(points, reach), len(points)
    runs = grid.around(reach)[grid.cell]
    plane, best = np.empty((n, 4)), np.empty((n, 2))
    is_flat = np.empty(n, dtype=np.bool_)
    offset = MAX_OFFSET * min_step
    for_row_blocks(lambda a, b: _fit_planes(grid, runs, reach, plane, a, b), n, BLOCK)
    for_row_blocks(
        lambda a, b: _choose_planes(grid, runs, reach, plane, offset, best, is_flat, a, b), n, BLOCK
    )
    parent = np.arange(n)
    of_block = block[grid.rows]
    _link_levels(grid, runs, of_block, reach, best, is_flat, min_step, parent)
    _follow_nearest(grid.points, of_block, is_flat, parent)
    part = np.empty(n, dtype=np.int64)
    part[grid.rows] = np.unique(parent, return_inverse=True)[1]
    return part


def _follow_nearest(
    points: NDArray[np.float64],
    block: NDArray[np.int64],
    is_flat: NDArray[np.bool_],
    parent: NDArray[np.int64],
) -> None:
    """Give points on no plane the root of the nearest in plan on one, or their block's first."""
    for number in np.unique(block[~is_flat]):
        members = np.flatnonzero(block == number)
        flat, others = members[is_flat[members]], members[~is_flat[members]]
        parent[others] = members[0]
        if len(flat):
            parent[others] = parent[flat[cKDTree(points[flat, :2]).query(points[others, :2])[1]]]


@kernel
def _near(grid, runs, x, y, radius, near):  # type: ignore[no-untyped-def]
    """Write the points of runs within a radius of a position in plan to `near`; return how many."""
    found = 0
    for row in range(len(runs)):
        for j in range(grid.first[runs[row, 0]], grid.first[runs[row, 1]]):
            if (grid.points[j, 0] - x) ** 2 + (grid.points[j, 1] - y) ** 2 <= radius * radius:
                near[found] = j
                found += 1
    return found


@kernel
def _fit_planes(grid, runs, reach, plane, begin, end):  # type: ignore[no-untyped-def]
    """Fit a plane about each sorted point begin to end: slope in x, in y, height, rms of residuals."""
    near = np.empty(len(grid.points), dtype=np.int64)
    moments, fitted = np.empty(N_MOMENTS), np.empty(4)
    for i in range(begin, end):
        x, y, z = grid.points[i]
        n = _near(grid, runs[i], x, y, reach, near)
        moments[:] = 0.0
        for j in near[:n]:
            add_point(moments, grid.points[j, 0] - x, grid.points[j, 1] - y, grid.points[j, 2] - z)
        residual = fitted_plane(moments, fitted)
        plane[i] = 0.0
        plane[i, 3] = np.inf
        if n >= MIN_NEIGHBOURS and residual >= 0.0 and fitted[2] > MIN_UPRIGHT:
            plane[i, 0], plane[i, 1] = -fitted[0] / fitted[2], -fitted[1] / fitted[2]
            plane[i, 2], plane[i, 3] = z - fitted[3] / fitted[2], np.sqrt(residual / n) / fitted[2]


@kernel
def _choose_planes(grid, runs, reach, plane, max_offset, best, is_flat, begin, end):  # type: ignore[no-untyped-def]
    """Give each of the sorted points begin to end the slope of the best plane near it that passes it."""
    near = np.empty(len(grid.points), dtype=np.int64)
    for i in range(begin, end):
        x, y, z = grid.points[i]
        best[i, 0] = best[i, 1] = 0.0
        least = np.inf
        for j in near[: _near(grid, runs[i], x, y, reach, near)]:
            there = (
                plane[j, 2] + plane[j, 0] * (x - grid.points[j, 0]) + plane[j, 1] * (y - grid.points[j, 1])
            )
            if plane[j, 3] < least and abs(z - there) <= max_offset:
                least = plane[j, 3]
                best[i, 0], best[i, 1] = plane[j, 0], plane[j, 1]
        is_flat[i] = least <= max_offset


@kernel
def _link_levels(grid, runs, block, reach, best, is_flat, min_step, parent):  # type: ignore[no-untyped-def]
    """Link neighbours of one block that lie on one level, the slope of either taken off."""
    near = np.empty(len(grid.points), dtype=np.int64)
    for i in range(len(grid.points)):
        if not is_flat[i]:
            continue
        x, y, z = grid.points[i]
        for j in near[: _near(grid, runs[i], x, y, reach, near)]:
            if j <= i or not is_flat[j] or block[i] != block[j]:
                continue
            dx, dy, dz = grid.points[j, 0] - x, grid.points[j, 1] - y, grid.points[j, 2] - z
            step = min(
                abs(dz - best[i, 0] * dx - best[i, 1] * dy), abs(dz - best[j, 0] * dx - best[j, 1] * dy)
            )
            if step < min_step:
                link(parent, i, j)
    flatten(parent)
