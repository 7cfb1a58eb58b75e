"""Methods ``lasclassify`` and ``single_returns``: roofs by published rules."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import CellGrid, rows_by_cell
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.stages.roof_selection.candidates import (
    MAX_ANGLE_DEG,
    MAX_LINEARITY,
    MAX_SLOPE_DEG,
    Candidates,
    near_tangent_plane,
)
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.surfaces.eigenfeatures import eigen_features
from lidar_buildings.core.surfaces.point_moments import N_MOMENTS, add_point, covariance
from lidar_buildings.core.surfaces.surface_patches import smooth_patches
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


def planar_cells(candidates: Candidates, config: RoofSelectionConfig) -> NDArray[np.bool_]:
    """
    Tell which of the points high enough lie in planar cells, or continue one.

    After the public documentation of lasclassify, the tool that Santos and others used with its defaults:
    among the points `min_height` above ground, those in square cells that deviate from a common plane by no
    more than `max_planar_deviation` are potential roof, those in cells that deviate by more than
    `min_rugged_deviation` potential vegetation; the grid is laid at several places, roofs are found before
    vegetation, and completed along their edges. What the documentation leaves open is decided here: the
    deviation is orthogonal to the plane, one planar cell is enough, and edges are completed along the planes
    by what does not lie in rugged cells alone. Of `config` `planarity_cell`, `max_planar_deviation`,
    `min_rugged_deviation` and, for the edges, `max_plane_distance` count.
    """
    high = candidates.columns
    side = max(config.planarity_cell, MIN_CELL_SPACINGS * candidates.cell / 2.0)
    kind, normals = _judged(high.points, side, config)
    is_planar = kind == PLANAR
    continued = near_tangent_plane(high, normals[is_planar], is_planar, side / 2.0, config.max_plane_distance)
    return continued & (kind != RUGGED)


def _judged(
    points: NDArray[np.float64], side: float, config: RoofSelectionConfig
) -> tuple[NDArray[np.int8], NDArray[np.float64]]:
    """Return what the cells make of each point, and the normal of the most planar one."""
    limits = (config.max_planar_deviation, config.min_rugged_deviation, math.cos(math.radians(MAX_SLOPE_DEG)))
    kind = np.full(len(points), UNKNOWN, dtype=np.int8)
    least = np.full(len(points), np.inf)
    normals = np.zeros((len(points), 3))
    for place in range(SUBSTEPS**2):
        east, north = np.array(divmod(place, SUBSTEPS)) * side / SUBSTEPS
        cells = rows_by_cell(points - [east, north, 0.0], side)
        for_row_blocks(
            lambda begin, end, cells=cells: _judge(  # type: ignore[misc]
                points, cells.rows, cells.first, limits, kind, least, normals, begin, end
            ),
            len(cells.numbers),
            CELL_BLOCK,
        )
    return kind, normals


@kernel
def _judge(points, rows, first, limits, kind, least, normals, begin, end):  # type: ignore[no-untyped-def]
    max_planar, min_rugged, min_upward = limits
    moments = np.empty(N_MOMENTS)
    for cell in range(begin, end):
        inside = rows[first[cell] : first[cell + 1]]
        if len(inside) < MIN_CELL_POINTS:
            continue
        moments[:] = 0.0
        x, y, z = points[inside[0]]
        for i in inside:
            add_point(moments, points[i, 0] - x, points[i, 1] - y, points[i, 2] - z)
        first_value, second_value, third_value, a, b, c = values_and_normal(*covariance(moments))
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


#: A plane through fewer points says nothing of their deviation from it.
MIN_PLANE_POINTS = 4
#: Fewest points of a plane.
MIN_PATCH_POINTS = 6


def single_return_planes(candidates: Candidates, config: RoofSelectionConfig) -> NDArray[np.bool_]:
    """
    Tell which of the points high enough are single returns on planes.

    Mancera-Taboada and others (2012) call building what has a single return, lies 0.65 m above ground, and
    covers 40 m²; roofs are smooth and regular, their planes are what is looked for. Height and area are
    `min_height` and `min_building_area`; `roof_returns` says which returns count. Others are never roof: the
    edges of roofs, where pulses are split, are lost as they were in the paper. Of `config` `roof_returns`,
    `max_roughness` and `max_plane_distance` count.
    """
    counts = {
        "single": candidates.is_only,
        "last": candidates.is_last,
        "all": np.ones(len(candidates.points), dtype=bool),
    }
    counted = candidates.columns.select(counts[config.roof_returns])
    radius = candidates.radius
    normals, is_plane = _planes(counted, radius, config)
    found = np.zeros(len(candidates.points), dtype=bool)
    found[counted.rows] = near_tangent_plane(
        counted, normals[is_plane], is_plane, radius, config.max_plane_distance
    )
    return found


def _planes(
    columns: CellGrid, radius: float, config: RoofSelectionConfig
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the normals, and which points lie within a plane of some extent."""
    features = eigen_features(columns.points, [radius], min_neighbours=MIN_PLANE_POINTS)
    is_flat = (features.roughness <= config.max_roughness) & (features.n_neighbours >= MIN_PLANE_POINTS)
    is_flat &= (features.linearity <= MAX_LINEARITY) & (features.eigenvalues[:, 0] > 0)
    is_flat &= features.normals[:, 2] >= math.cos(math.radians(MAX_SLOPE_DEG))
    rows = np.flatnonzero(is_flat)
    patch = smooth_patches(
        columns.select(is_flat),
        features.normals[rows],
        np.full(len(rows), radius),
        max_angle_deg=MAX_ANGLE_DEG,
        max_offset=config.max_plane_distance,
    )
    is_flat[rows] = (np.bincount(patch) >= MIN_PATCH_POINTS)[patch]
    return features.normals, is_flat
