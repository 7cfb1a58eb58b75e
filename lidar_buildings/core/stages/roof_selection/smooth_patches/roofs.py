"""The default method: smooth patches, completed to roofs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.stages.roof_selection.candidates import Candidates
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.smooth_patches.attached_parts import wide_levels
from lidar_buildings.core.stages.roof_selection.smooth_patches.canopies import is_canopy
from lidar_buildings.core.stages.roof_selection.smooth_patches.narrow_parts import half_widths, wide_enough
from lidar_buildings.core.stages.roof_selection.smooth_patches.parapets import find_parapets
from lidar_buildings.core.stages.roof_selection.smooth_patches.roof_patches import find_roof_surface
from lidar_buildings.core.stages.roof_selection.surroundings import near_tangent_plane, surrounded_by
from lidar_buildings.core.surfaces.surface_patches import connected_parts, plan_areas

#: How far to look for roof around a part [m], and at least in neighbourhood radii.
PART_REACH = 2.0
PART_REACH_RADII = 2.0
#: How far a part may lie below the lowest roof around it [m].
PART_SINK = 0.5
#: How far a chimney, dormer or other part may rise above the roof around it: one storey [m].
MAX_PART_HEIGHT = 3.0
#: Share of a part's points that have to have roof around them.
PART_SHARE = 0.7
#: Side of the cells in which narrow parts are found: half of an area's cell, but no smaller than this [m].
MIN_PLAN_CELL = 0.25


def find_roofs(candidates: Candidates, config: RoofSelectionConfig) -> NDArray[np.bool_]:
    """
    Tell which of the points above ground are roof.

    Patches start roofs, which grow to their edges along tangent planes, whichever the return, and take in
    what stands on them: last returns with roof all around, and small parts, unless the roof is seen through
    them; and parapets. What is too narrow goes, on its level and as a whole.

    Parameters
    ----------
    candidates : Candidates
        Of which those below `min_height` are never roof, but tell what the others are part of.
    config : RoofSelectionConfig
        The stage's parameters.

    Returns
    -------
    ndarray of bool, shape (n_points,)
        Roofs of any size; the caller drops small buildings.
    """
    points, radius, cell = candidates.points, candidates.radius, candidates.cell
    surface = find_roof_surface(candidates, config)
    roof = near_tangent_plane(points, surface.normals, surface.is_surface, radius, config.max_plane_distance)
    roof &= ~surface.is_wall
    too_low = candidates.height < config.min_height
    roof &= ~too_low
    reach = max(PART_REACH, PART_REACH_RADII * radius)
    held = surrounded_by(points, roof, reach, PART_SINK, MAX_PART_HEIGHT)
    stands = _small_parts(points, roof, held, radius, cell, config) | (held & candidates.is_last)
    roof |= stands & ~is_canopy(points, roof, stands, radius)
    roof &= ~surface.is_wall
    roof |= find_parapets(points, roof, surface.is_surface, radius)
    roof &= ~too_low
    _drop_narrow(points, roof, radius, max(MIN_PLAN_CELL, cell / 2), config)
    return roof


def _drop_narrow(
    points: NDArray[np.float64],
    roof: NDArray[np.bool_],
    radius: float,
    cell: float,
    config: RoofSelectionConfig,
) -> None:
    """Take narrow parts out of the roofs, and then what is nowhere as wide as a building."""
    rows = np.flatnonzero(roof)
    roof[rows] = wide_enough(points[rows], cell, config.min_roof_width)
    rows = np.flatnonzero(roof)
    roof[rows] = wide_levels(points[rows], radius, cell, config)
    rows = np.flatnonzero(roof)
    if len(rows) == 0 or config.min_building_width < 2.0 * cell:
        return
    building = connected_parts(points[rows], radius, in_plan=True)
    widest = np.zeros(building.max() + 1)
    np.maximum.at(widest, building, half_widths(points[rows], cell, config.min_building_width))
    roof[rows] = (2.0 * widest >= config.min_building_width)[building]


def _small_parts(
    points: NDArray[np.float64],
    roof: NDArray[np.bool_],
    held: NDArray[np.bool_],
    radius: float,
    cell: float,
    config: RoofSelectionConfig,
) -> NDArray[np.bool_]:
    """Tell which points are of small connected parts, not roof yet, mostly with roof around."""
    rows = np.flatnonzero(~roof)
    part = connected_parts(points[rows], radius)
    share = np.bincount(part, held[rows]) / np.bincount(part)
    small = plan_areas(points[rows], part, cell) <= config.max_part_area
    kept = np.zeros(len(points), dtype=bool)
    kept[rows] = (small & (share >= PART_SHARE))[part]
    return kept
