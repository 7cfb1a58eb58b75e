"""The default method: smooth patches, completed to roofs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.columns import Columns, by_column
from lidar_buildings.core.stages.roof_selection.candidates import Candidates
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.smooth_patches.attached_parts import LEVEL_STEP, wide_levels
from lidar_buildings.core.stages.roof_selection.smooth_patches.narrow_parts import wide_enough
from lidar_buildings.core.stages.roof_selection.smooth_patches.plane_votes import find_voted_surface
from lidar_buildings.core.stages.roof_selection.smooth_patches.rims import stands_out
from lidar_buildings.core.stages.roof_selection.smooth_patches.roof_patches import (
    LARGE_PATCH_AREA,
    find_roof_surface,
)
from lidar_buildings.core.stages.roof_selection.surroundings import near_tangent_plane, surroundings
from lidar_buildings.core.surfaces.surface_patches import connected_columns, plan_areas

#: How far to look for roof around a part [m], and at least in neighbourhood radii, up to a face's width: what
#: is farther away is another house's.
PART_REACH = 2.0
PART_REACH_RADII = 2.0
#: Sectors of eight that have to show roof: a part at a straight roof edge sees it in five.
MIN_SECTORS = 6
#: How far a part may lie below the lowest roof around it [m].
PART_SINK = 0.5
#: How far a chimney, dormer or other part may rise above the roof around it: one storey [m].
MAX_PART_HEIGHT = 3.0
#: Wider neighbourhoods reach beyond the faces of houses and are hardly ever smooth [m].
FACE_WIDTH = 4.0
#: Side of the cells in which narrow parts are found: half of an area's cell, but no smaller than this [m].
MIN_PLAN_CELL = 0.25


def find_roofs(
    candidates: Candidates, config: RoofSelectionConfig
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """
    Tell which of the points above ground are roof, and which are walls, whether of these roofs or not.

    Patches start roofs, which grow to their edges along tangent planes, whichever the return. Vehicles that
    touch one go before roofs take in what stands on them, last returns with roof all around and small parts:
    the wall between a lorry and its dock would join the two. What is too narrow goes, on its level and as a
    whole, and what is too small.
    """
    columns, radius = candidates.columns, candidates.radius
    surface = (find_voted_surface if 2.0 * radius > FACE_WIDTH else find_roof_surface)(candidates, config)
    roof = ~surface.is_other & near_tangent_plane(
        columns, surface.normals, surface.is_surface, radius, config.max_plane_distance
    )
    is_other, is_wall = surface.is_other, surface.is_wall
    del surface  # memory
    roof = _levels(candidates, roof, config, is_bare=True)[0] >= 0
    held = _held(columns, roof, radius)
    stands = _small_parts(candidates, roof, held, config) | (held & candidates.is_last)
    roof |= stands & ~is_other
    return _without_narrow(candidates, roof, config), is_wall


def _held(columns: Columns, roof: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    """Tell which points stand on a roof: roof all around in plan, and at about its height."""
    around = surroundings(columns, roof, max(PART_REACH, min(PART_REACH_RADII * radius, FACE_WIDTH)), ~roof)
    low, high = around.lowest - PART_SINK, around.highest + MAX_PART_HEIGHT
    is_inside = around.n_sectors >= MIN_SECTORS
    column, z = columns.column, columns.points[:, 2]
    return ~roof & is_inside[column] & (z >= low[column]) & (z <= high[column])


def _small_parts(
    candidates: Candidates, roof: NDArray[np.bool_], held: NDArray[np.bool_], config: RoofSelectionConfig
) -> NDArray[np.bool_]:
    """Tell which points are of small connected parts, not roof yet, mostly with roof around."""
    rows = np.flatnonzero(~roof)
    label, n = candidates.parts(rows, candidates.radius)
    part = label[rows]
    is_held = 2 * np.bincount(part, held[rows], n) >= np.bincount(part, minlength=n)
    kept = np.zeros(len(roof), dtype=bool)
    kept[rows] = (is_held & (candidates.areas(label, n) <= config.max_part_area))[part]
    return kept


def _without_narrow(
    candidates: Candidates, roof: NDArray[np.bool_], config: RoofSelectionConfig
) -> NDArray[np.bool_]:
    """
    Take out of the roofs what is too narrow, in plan and on its level, and what is too small.

    Buildings end, and so do their parts: but for large ones, which are no spots of a crown above a roof.
    """
    label, n = _levels(candidates, roof, config)
    ends = _ending(candidates, *candidates.buildings(label >= 0, config.min_building_area))
    label = np.where(ends, label, -1)
    is_large = np.append(candidates.areas(label, n) >= LARGE_PATCH_AREA, False)
    return _ending(candidates, label, n) | is_large[label]


def _levels(
    candidates: Candidates, roof: NDArray[np.bool_], config: RoofSelectionConfig, *, is_bare: bool = False
) -> tuple[NDArray[np.int64], int]:
    """Return the level of each roof point, −1 where it is too narrow, or the plan of whole roofs is."""
    rows, plan = np.flatnonzero(roof), candidates.columns.select(roof)
    if not is_bare:
        plan = by_column(plan.points, max(MIN_PLAN_CELL, 0.5 * candidates.cell))
        rows = rows[plan.rows]
        is_wide = wide_enough(plan, config.min_roof_width)[plan.column]
        rows, plan = rows[is_wide], plan.select(is_wide)
    part = connected_columns(plan, max(LEVEL_STEP, candidates.radius))
    n = int(part.max(initial=-1)) + 1
    is_wide = wide_levels(plan, part, plan_areas(part, n, plan.first, plan.size), config, is_bare=is_bare)
    label = np.full(len(roof), -1)
    label[rows] = np.where(is_wide, part, -1)
    return label, n


def _ending(candidates: Candidates, label: NDArray[np.int64], n_labels: int) -> NDArray[np.bool_]:
    """Tell which points are of labels, −1 being none, that stand out."""
    rows = candidates.cells.rows
    ends = stands_out(candidates.cells, candidates.points[rows, 2], label[rows], n_labels)
    return np.asarray(np.append(ends, False)[label])
