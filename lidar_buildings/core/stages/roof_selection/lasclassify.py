"""Roofs by the published rules of LAStools' lasclassify: cells that are planar, cells that are rugged."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.stages.roof_selection.candidates import MAX_SLOPE_DEG, Candidates
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.surroundings import MAX_LINEARITY, near_tangent_plane
from lidar_buildings.core.surfaces.symmetric_eigen import values_and_normal

#: Places of the grid along x and along y at which every point is judged ("substeps").
SUBSTEPS = 4
#: Cells are at least so many spacings wide: eight pulses in each, as cells of 2 m have of two pulses a square
#: metre, the least that the tool's documentation calls reliable.
MIN_CELL_SPACINGS = 2.0 * math.sqrt(2.0)
#: A plane through fewer points says nothing of their deviation from it.
MIN_CELL_POINTS = 5
#: Cells counted per block of rows: one stands for some ten points.
CELL_BLOCK = 1024
#: What a cell makes of its points; of several cells the one with the highest number counts.
UNKNOWN, RUGGED, NEITHER, PLANAR = range(4)


def find_roofs(candidates: Candidates, config: RoofSelectionConfig) -> NDArray[np.bool_]:
    """
    Tell which of the points high enough lie in planar cells, or continue one.

    After the public documentation of lasclassify, the tool that Santos and others used with its defaults:
    among the points `min_height` above ground, those in square cells that deviate from a common plane by no
    more than `max_planar_deviation` are potential roof, those in cells that deviate by more than
    `min_rugged_deviation` potential vegetation; the grid is laid at several places, roofs are found before
    vegetation, and completed along their edges. What the documentation leaves open is decided here: the
    deviation is orthogonal to the plane, one planar cell is enough, and edges are completed along the planes
    by what does not lie in rugged cells alone.

    Parameters
    ----------
    candidates : Candidates
        Of which returns have no say in the published rules; cells have a size of their own.
    config : RoofSelectionConfig
        `planarity_cell`, `max_planar_deviation`, `min_rugged_deviation`, and `max_plane_distance` for the
        edges.

    Returns
    -------
    ndarray of bool, shape (n_points,)
        Roofs of buildings.
    """
    high = candidates.columns
    side = max(config.planarity_cell, MIN_CELL_SPACINGS * candidates.cell / 2.0)
    kind, normals = _judged(high.points, side, config)
    is_planar = kind == PLANAR
    continued = near_tangent_plane(high, normals[is_planar], is_planar, side / 2.0, config.max_plane_distance)
    return candidates.of_buildings(continued & (kind != RUGGED), config.min_building_area)


def _judged(
    points: NDArray[np.float64], side: float, config: RoofSelectionConfig
) -> tuple[NDArray[np.int8], NDArray[np.float64]]:
    """Return what the cells make of each point, and the normal of the most planar one."""
    limits = (config.max_planar_deviation, config.min_rugged_deviation, math.cos(math.radians(MAX_SLOPE_DEG)))
    kind = np.full(len(points), UNKNOWN, dtype=np.int8)
    least = np.full(len(points), np.inf)
    normals = np.zeros((len(points), 3))
    for place in range(SUBSTEPS**2):
        shift = np.array(divmod(place, SUBSTEPS)) / SUBSTEPS
        rows, first = _cells(points, side, shift)
        for_row_blocks(
            lambda begin, end, rows=rows, first=first: _judge(  # type: ignore[misc]
                points, rows, first, limits, kind, least, normals, begin, end
            ),
            len(first) - 1,
            CELL_BLOCK,
        )
    return kind, normals


def _cells(
    points: NDArray[np.float64], side: float, shift: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows in the order of their cells, and where in it each cell begins."""
    column, row = np.floor(points[:, :2] / side - shift).T
    rows = np.lexsort((row, column))
    changes = (np.diff(column[rows]) != 0) | (np.diff(row[rows]) != 0)
    return rows, np.concatenate([[0], np.flatnonzero(changes) + 1, [len(rows)]]).astype(np.int64)


@kernel
def _judge(points, rows, first, limits, kind, least, normals, begin, end):  # type: ignore[no-untyped-def]
    max_planar, min_rugged, min_upward = limits
    for c in range(begin, end):
        inside = rows[first[c] : first[c + 1]]
        if len(inside) < MIN_CELL_POINTS:
            continue
        first_value, second_value, third_value, a, b, c = values_and_normal(*_covariance(points, inside))
        deviation = math.sqrt(third_value)
        found = RUGGED if deviation > min_rugged else NEITHER
        is_line = first_value - second_value > MAX_LINEARITY * first_value or first_value == 0.0
        if deviation <= max_planar and c >= min_upward and not is_line:
            found = PLANAR
        for i in inside:
            kind[i] = max(kind[i], found)
            if found == PLANAR and deviation < least[i]:
                least[i] = deviation
                normals[i, 0], normals[i, 1], normals[i, 2] = a, b, c


@inner_kernel
def _covariance(points, inside):  # type: ignore[no-untyped-def]
    """Return xx, xy, xz, yy, yz, zz about the mean of the points of one cell."""
    n = len(inside)
    x = y = z = 0.0
    for i in inside:
        x, y, z = x + points[i, 0], y + points[i, 1], z + points[i, 2]
    x, y, z = x / n, y / n, z / n
    xx = xy = xz = yy = yz = zz = 0.0
    for i in inside:
        dx, dy, dz = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
        xx, xy, xz = xx + dx * dx, xy + dx * dy, xz + dx * dz
        yy, yz, zz = yy + dy * dy, yz + dy * dz, zz + dz * dz
    return xx / n, xy / n, xz / n, yy / n, yz / n, zz / n
