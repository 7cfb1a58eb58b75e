"""Buildings that touch at different heights, split at the step edges between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.neighbourhoods import build_grid, neighbours_of
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.neighbours.union_find import flatten, link
from lidar_buildings.core.stages.segmentation.members import occupied_areas
from lidar_buildings.core.stages.segmentation.part_borders import measure_borders, merge_parts
from lidar_buildings.core.stages.segmentation.part_shape import plan_sums

#: Radius within which planes are fitted and neighbours linked [spacings].
REACH = 2.25
#: Fewest neighbours that a plane is fitted to.
MIN_NEIGHBOURS = 6
#: A plane is some point's if it passes it within this share of the least step.
MAX_OFFSET = 0.25
#: Cells in which borders are measured [spacings]: hardly one of them is empty amid a roof.
BORDER_CELL = 2.0
#: Least width of a part, from its area and perimeter and from how its points scatter: dormers and ledges go
#: back to their buildings [m].
MIN_PART_WIDTH = 2.5
#: Points a block of work.
BLOCK = 2048


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
    back to the one with which they share the longest border, the smallest first.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In any order [m].
    block : ndarray of int64, shape (n_points,)
        From 0, or −1 for points of none.
    n_blocks : int
        Number of blocks.
    spacing : float
        1/√density [m].
    min_step_height, min_area : float
        See `SegmentationConfig` [m], [m²].

    Returns
    -------
    part : ndarray of int64, shape (n_points,)
        From 0; −1 where there is no block.
    block_of_part : ndarray of int64
        The block of every part.
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
        into = merge_parts(
            borders,
            area,
            block_of_linked,
            min_area=min_area,
            min_width=MIN_PART_WIDTH,
            sums=plan_sums(some, linked, n_linked),
        )
        kept, linked = np.unique(into[linked], return_inverse=True)
        block_of_linked = block_of_linked[kept]
    part = np.full(len(points), -1, dtype=np.int64)
    part[rows] = linked
    return part, block_of_linked


def _linked_parts(
    points: NDArray[np.float64], block: NDArray[np.int64], reach: float, min_step: float
) -> NDArray[np.int64]:
    """Number the parts that links connect, before any goes back to another."""
    grid = build_grid(points, reach)
    n = len(points)
    plane, best = np.empty((n, 4)), np.empty((n, 2))
    is_flat = np.empty(n, dtype=np.bool_)
    offset = MAX_OFFSET * min_step
    for_row_blocks(lambda a, b: _fit_planes(grid, reach, plane, a, b), n, BLOCK)
    for_row_blocks(lambda a, b: _choose_planes(grid, reach, plane, offset, best, is_flat, a, b), n, BLOCK)
    parent = np.arange(n)
    of_block = block[grid.rows]
    _link_levels(grid, of_block, reach, best, is_flat, min_step, parent)
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
    """
    Give points on no plane the root of the nearest that is on one, or their block's first where none is.

    Nearest in plan: half-way up a tower's wall, the roof of another tower may be nearer than its own.
    """
    for number in np.unique(block[~is_flat]):
        members = np.flatnonzero(block == number)
        flat, others = members[is_flat[members]], members[~is_flat[members]]
        parent[others] = members[0]
        if len(flat):
            parent[others] = parent[flat[cKDTree(points[flat, :2]).query(points[others, :2])[1]]]


@kernel
def _fit_planes(grid, reach, plane, begin, end):  # type: ignore[no-untyped-def]
    """
    Fit a plane about each of the sorted points begin to end: slope in x, in y, height, rms of residuals.
    """
    near = np.empty(len(grid.points), dtype=np.int64)
    for i in range(begin, end):
        x, y, z = grid.points[i]
        n = neighbours_of(grid, grid.cell[i], x, y, z, reach, True, near)
        plane[i] = 0.0
        plane[i, 3] = np.inf
        if n >= MIN_NEIGHBOURS:
            _fit_plane(grid.points, i, near[:n], reach, plane[i])


@kernel
def _fit_plane(points, i, near, reach, plane):  # type: ignore[no-untyped-def]
    """Fit the plane of least squares to heights of neighbours; left as it is where they lie on a line."""
    sx = sy = sz = sxx = sxy = syy = sxz = syz = szz = 0.0
    for j in near:
        x, y, z = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
        sx, sy, sz = sx + x, sy + y, sz + z
        sxx, sxy, syy = sxx + x * x, sxy + x * y, syy + y * y
        sxz, syz, szz = sxz + x * z, syz + y * z, szz + z * z
    n = len(near)
    sxx, sxy, syy = sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
    sxz, syz, szz = sxz - sx * sz / n, syz - sy * sz / n, szz - sz * sz / n
    determinant = sxx * syy - sxy * sxy
    if determinant <= 1e-4 * (n * reach * reach) ** 2 / 16.0:
        return
    a = (sxz * syy - syz * sxy) / determinant
    b = (syz * sxx - sxz * sxy) / determinant
    plane[0], plane[1] = a, b
    plane[2] = points[i, 2] + (sz - a * sx - b * sy) / n
    plane[3] = np.sqrt(max(szz - a * sxz - b * syz, 0.0) / n)


@kernel
def _choose_planes(grid, reach, plane, max_offset, best, is_flat, begin, end):  # type: ignore[no-untyped-def]
    """Give each of the sorted points begin to end the slope of the best plane near it that passes it."""
    near = np.empty(len(grid.points), dtype=np.int64)
    for i in range(begin, end):
        x, y, z = grid.points[i]
        best[i, 0] = best[i, 1] = 0.0
        least = np.inf
        for j in near[: neighbours_of(grid, grid.cell[i], x, y, z, reach, True, near)]:
            there = (
                plane[j, 2] + plane[j, 0] * (x - grid.points[j, 0]) + plane[j, 1] * (y - grid.points[j, 1])
            )
            if plane[j, 3] < least and abs(z - there) <= max_offset:
                least = plane[j, 3]
                best[i, 0], best[i, 1] = plane[j, 0], plane[j, 1]
        is_flat[i] = least <= max_offset


@kernel
def _link_levels(grid, block, reach, best, is_flat, min_step, parent):  # type: ignore[no-untyped-def]
    """Link neighbours of one block that lie on one level, the slope of either taken off."""
    near = np.empty(len(grid.points), dtype=np.int64)
    for i in range(len(grid.points)):
        if not is_flat[i]:
            continue
        x, y, z = grid.points[i]
        for j in near[: neighbours_of(grid, grid.cell[i], x, y, z, reach, True, near)]:
            if j <= i or not is_flat[j] or block[i] != block[j]:
                continue
            dx, dy, dz = grid.points[j, 0] - x, grid.points[j, 1] - y, grid.points[j, 2] - z
            step = min(
                abs(dz - best[i, 0] * dx - best[i, 1] * dy), abs(dz - best[j, 0] * dx - best[j, 1] * dy)
            )
            if step < min_step:
                link(parent, i, j)
    flatten(parent)
