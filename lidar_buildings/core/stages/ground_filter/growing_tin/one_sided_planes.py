"""
Points that continue the terrain on one side, whatever it does on the other: rims of cliffs and terraces.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.neighbours.windows import cells_in_row
from lidar_buildings.core.surfaces.point_moments import N_MOMENTS, add_point, covariance

# These and the rules below were chosen with `bench.ground.isprs` and `bench.ground.scenes`.
#: Half planes that are tried.
SIDES = 8
#: How far the points of a plane may be, and how near the nearest of them has to be, in spacings.
REACH, NEAREST = 3.5, 2.0
#: Fewest points of a plane.
MIN_POINTS = 6
#: Its steepest slope, rise over run, and its largest root mean square residual [m].
MAX_SLOPE, MAX_RESIDUAL = 0.8, 0.25
#: How far from it a point may be beyond that residual [m].
MAX_DISTANCE = 0.3
#: Least 4 λ₁ λ₂ / (λ₁ + λ₂)² of the points' moments in plan: 1 if they lie all round, 0 if on a line.
MIN_SPREAD = 0.05
#: Rows a block of work; wide margin, the result does not depend on it.
ROWS_A_BLOCK = 1024


def continues_terrain(
    candidates: NDArray[np.float64], rows: NDArray[np.intp], ground: NDArray[np.bool_], spacing: float
) -> NDArray[np.bool_]:
    """
    Return which of the rows lie on the plane through the ground in a half plane around them.

    A robust form of mirroring (Axelsson 2000): instead of one corner's far side, all ground on one side of
    the point has to make a plane that the point lies on. A roof has ground below it on every side.

    Candidates, ground and spacing are those of `find_landforms`; `rows` are the candidates asked for.
    """
    known = candidates[ground]
    result = np.zeros(len(rows), dtype=np.bool_)
    if len(known) < MIN_POINTS:
        return result
    cells = sort_by_cell(known, REACH * spacing)
    # A candidate's cell by the same numbering, without sorting again: from the first known point's.
    column = math.floor(cells.points[0, 0] / cells.size) - cells.numbers[0] % cells.n_columns
    row = math.floor(cells.points[0, 1] / cells.size) - cells.numbers[0] // cells.n_columns
    start = (float(column), float(row))
    for_row_blocks(
        lambda a, b: _test(candidates, rows, cells, start, spacing, result, a, b),
        len(rows),
        ROWS_A_BLOCK,
    )
    return result


@kernel
def _test(candidates, rows, cells, start, spacing, result, begin, end):  # type: ignore[no-untyped-def]
    sums = np.empty((SIDES, N_MOMENTS + 1))
    towards = np.empty((SIDES, 2))
    for side in range(SIDES):
        turn = 2.0 * math.pi * side / SIDES
        towards[side, 0], towards[side, 1] = math.cos(turn), math.sin(turn)
    for r in range(begin, end):
        x, y, z = candidates[rows[r]]
        sums[:] = 0.0
        sums[:, N_MOMENTS] = np.inf
        # Whole numbers before the product: over an enormous extent it would be rounded.
        column = np.int64(math.floor(x / cells.size) - start[0])
        line = np.int64(math.floor(y / cells.size) - start[1])
        for beside in range(line - 1, line + 2):
            low, high = cells_in_row(cells.numbers, cells.n_columns, beside, column, 1)
            for i in range(cells.first[low], cells.first[high]):
                dx, dy, dz = cells.points[i, 0] - x, cells.points[i, 1] - y, cells.points[i, 2] - z
                _count(dx, dy, dz, REACH * spacing, towards, sums)
        for side in range(SIDES):
            if _fits(sums[side], NEAREST * spacing):
                result[r] = True
                break


@kernel
def _count(dx, dy, dz, reach, towards, sums):  # type: ignore[no-untyped-def]
    """Add a ground point, relative to the candidate, to the moments of the sides it lies on."""
    away = math.hypot(dx, dy)
    if away > reach:
        return
    for side in range(SIDES):
        if dx * towards[side, 0] + dy * towards[side, 1] <= 1e-9:
            continue
        s = sums[side]
        add_point(s, dx, dy, dz)
        s[N_MOMENTS] = min(s[N_MOMENTS], away)


@kernel
def _fits(s, nearest):  # type: ignore[no-untyped-def]
    """Whether the moments make a plane that passes near the candidate, which lies at the origin."""
    n = s[0]
    if n < MIN_POINTS or s[N_MOMENTS] > nearest:
        return False
    x, y, z = s[1] / n, s[2] / n, s[3] / n
    xx, xy, xz, yy, yz, zz = covariance(s)
    determinant = xx * yy - xy * xy
    if determinant <= MIN_SPREAD * 0.25 * (xx + yy) ** 2:
        return False
    a, b = (xz * yy - yz * xy) / determinant, (yz * xx - xz * xy) / determinant
    residual = math.sqrt(max(0.0, zz - a * xz - b * yz))
    if math.hypot(a, b) > MAX_SLOPE or residual > MAX_RESIDUAL:
        return False
    return abs(z - a * x - b * y) <= MAX_DISTANCE + residual
