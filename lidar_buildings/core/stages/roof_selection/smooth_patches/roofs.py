"""The default method: smooth patches, completed to roofs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.columns import Columns, by_column
from lidar_buildings.core.stages.roof_selection.candidates import Candidates
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.smooth_patches.attached_parts import LEVEL_STEP, wide_levels
from lidar_buildings.core.stages.roof_selection.smooth_patches.narrow_parts import half_widths, wide_enough
from lidar_buildings.core.stages.roof_selection.smooth_patches.roof_patches import find_roof_surface
from lidar_buildings.core.stages.roof_selection.surroundings import near_tangent_plane, surroundings
from lidar_buildings.core.surfaces.surface_patches import plan_areas

#: How far to look for roof around a part [m], and at least in neighbourhood radii.
PART_REACH = 2.0
PART_REACH_RADII = 2.0
#: Sectors of eight that have to show roof: a part at a straight roof edge sees it in five.
MIN_SECTORS = 6
#: How far a part may lie below the lowest roof around it [m].
PART_SINK = 0.5
#: How far a chimney, dormer or other part may rise above the roof around it: one storey [m].
MAX_PART_HEIGHT = 3.0
#: Share of a part's points that have to have roof around them.
PART_SHARE = 0.7
#: Where neighbourhoods are wider than faces: mean votes, of twelve, around a point of a roof, and those from
#: which on it is one whatever its patch. Houses have 7 in the mean, crowns 1 to 3.
MIN_VOTES, SURE_VOTES = 4.0, 5.5
#: Side of the cells in which narrow parts are found: half of an area's cell, but no smaller than this [m].
MIN_PLAN_CELL = 0.25


def find_roofs(candidates: Candidates, config: RoofSelectionConfig) -> NDArray[np.bool_]:
    """
    Tell which of the points above ground are roof.

    Patches start roofs, which grow to their edges along tangent planes, whichever the return, and take in
    what stands on them: last returns with roof all around, and small parts. What is too narrow goes, on its
    level and as a whole, and what is too small.

    Parameters
    ----------
    candidates : Candidates
        Of which those below `min_height` are never roof, but tell what the others are part of.
    config : RoofSelectionConfig
        The stage's parameters.

    Returns
    -------
    ndarray of bool, shape (n_points,)
        Roofs of buildings.
    """
    columns, radius = candidates.columns, candidates.radius
    surface = find_roof_surface(candidates, config)
    can_be_roof = ~surface.is_wall & (candidates.height >= config.min_height)
    roof = can_be_roof & near_tangent_plane(
        columns, surface.normals, surface.is_surface, radius, config.max_plane_distance
    )
    if surface.votes is not None:
        roof = (roof & (surface.votes >= MIN_VOTES)) | (surface.votes >= SURE_VOTES)
        roof &= can_be_roof & ~surface.is_deck
    del surface
    held = _held(columns, roof, radius)
    stands = _small_parts(candidates, roof, held, config) | (held & candidates.is_last)
    roof |= stands & can_be_roof
    return _without_narrow(candidates, roof, config)


def _held(columns: Columns, roof: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    """Tell which points stand on a roof: roof all around in plan, and at about its height."""
    around = surroundings(columns, roof, max(PART_REACH, PART_REACH_RADII * radius), ~roof)
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
    is_held = np.bincount(part, held[rows], n) >= PART_SHARE * np.bincount(part, minlength=n)
    kept = np.zeros(len(roof), dtype=bool)
    kept[rows] = (is_held & (candidates.areas(label, n) <= config.max_part_area))[part]
    return kept


def _without_narrow(
    candidates: Candidates, roof: NDArray[np.bool_], config: RoofSelectionConfig
) -> NDArray[np.bool_]:
    """Take narrow parts out of the roofs, and then what is smaller or narrower than a building."""
    plan = by_column(candidates.points[roof], max(MIN_PLAN_CELL, 0.5 * candidates.cell))
    rows = np.flatnonzero(roof)[plan.rows]
    for kept in (_wide_enough, _on_wide_levels):
        is_kept = kept(candidates, plan, rows, config)
        plan, rows = plan.select(is_kept), rows[is_kept]
    found, is_wide = np.zeros((2, len(roof)), dtype=bool)
    found[rows] = is_wide[rows] = True
    if config.min_building_width >= 2.0 * plan.size:
        width = 2.0 * half_widths(plan, config.min_building_width)[plan.column]
        is_wide[rows] = width >= config.min_building_width
    return candidates.of_buildings(found, config.min_building_area, is_wide)


def _wide_enough(
    candidates: Candidates, plan: Columns, rows: NDArray[np.intp], config: RoofSelectionConfig
) -> NDArray[np.bool_]:
    return wide_enough(plan, config.min_roof_width)[plan.column]


def _on_wide_levels(
    candidates: Candidates, plan: Columns, rows: NDArray[np.intp], config: RoofSelectionConfig
) -> NDArray[np.bool_]:
    label, n = candidates.parts(rows, max(LEVEL_STEP, candidates.radius))
    part = label[rows]
    return wide_levels(plan, part, plan_areas(part, n, plan.first, plan.size), config)
