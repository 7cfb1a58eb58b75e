"""Progressive TIN densification: a coarse terrain grows, round by round, by the points that lie near it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.point_spacing import quantised_spacing
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.growing_tin.bridges import find_decks
from lidar_buildings.core.stages.ground_filter.growing_tin.landforms import find_landforms
from lidar_buildings.core.stages.ground_filter.growing_tin.roof_terrain import find_islands
from lidar_buildings.core.stages.ground_filter.growing_tin.seeds import choose_seeds
from lidar_buildings.core.stages.ground_filter.growing_tin.terrain_growth import (
    GrowthLimits,
    TerrainGrowth,
    start_growth,
)
from lidar_buildings.core.stages.ground_filter.growing_tin.tin_labels import near_terrain
from lidar_buildings.core.surfaces.tin import Tin

#: Largest roof that a seed may fall on, in cells of the seeds' grid.
MAX_ISLAND_CELLS = 1.0
#: Side of the cells whose lowest ground starts the terrain that stays, in cells of the candidates: facets
#: know only what is near, and growth has something left to decide.
LOCAL_CELL = 5.0


def densify(candidates: NDArray[np.float64], extent: NDArray[np.float64], config: GroundFilterConfig) -> Tin:
    """
    Return the terrain that the candidates make up (Axelsson 2000, with the thresholds taken facet by facet).

    A candidate joins the TIN if its distance to its facet and the angles at which it is seen from the facet's
    corners stay within limits; the angle's limit grows with the facet's own slope, so that the data set it
    where the terrain is, and the rest of the tile has no say. Candidates below a facet may join at any depth.
    On a facet that may span a step, a candidate too far above is mirrored at the facet's nearest corner and
    tested against the terrain there. Each round inserts one candidate a facet, the lowest below it or the one
    under the smallest angle, which keeps a single point on an object from pulling others after it.

    Limits that stop at every bush also stop at the foot of a bank. So the terrain then grows on, on trial,
    with bolder ones, and what it gains is judged part by part: a part that meets the terrain around it as
    terrain does is a landform and stays, one with steps around it is an object and is barred for good.

    Candidates on the decks of bridges, and on roofs that a seed fell on, are taken out then, and the terrain
    grows again without them.

    Which of many candidates that hardly differ join depends on where the large facets began, and so on seeds
    far away. So the terrain grows once more, from seeds chosen among its ground in small cells: what is
    beyond some cells has no say any more, and neighbouring tiles agree on what they share.

    Parameters
    ----------
    candidates : ndarray of shape (n_candidates, 3)
        At least one; at most one per place, gross errors removed, in an order that puts neighbours
        together [m].
    extent : ndarray of shape (2, 2)
        Lower left and upper right corner of what the terrain has to cover [m].
    config : GroundFilterConfig
        Thresholds.

    Returns
    -------
    Tin

    Notes
    -----
    Only candidates whose facet changed are looked at again, so the time is near linear in their number.
    """
    spacing = quantised_spacing(candidates)
    is_seed = np.zeros(len(candidates), dtype=np.bool_)
    is_seed[choose_seeds(candidates, config.seed_cell, config.max_seed_rise)] = True
    terrain = _grown(candidates, is_seed, extent, spacing, config)
    ground = near_terrain(*terrain.height_and_slope(), config)
    false = find_islands(candidates, ground, spacing, MAX_ISLAND_CELLS * config.seed_cell**2)
    false |= find_decks(terrain.tin(), candidates, spacing)
    if false.any() and (is_seed & ~false).any():
        candidates, is_seed = candidates[~false], is_seed[~false]
        terrain = _grown(candidates, is_seed, extent, spacing, config)
    local = np.zeros(len(candidates), dtype=np.bool_)
    rows = np.flatnonzero(near_terrain(*terrain.height_and_slope(), config))
    cell = LOCAL_CELL * config.candidate_spacing
    local[rows[choose_seeds(candidates[rows], cell, config.max_seed_rise)]] = True
    return _grown(candidates, local, extent, spacing, config).tin()


def _grown(
    candidates: NDArray[np.float64],
    is_seed: NDArray[np.bool_],
    extent: NDArray[np.float64],
    spacing: float,
    config: GroundFilterConfig,
) -> TerrainGrowth:
    """Return the terrain grown from its seeds, landforms included."""
    terrain = start_growth(candidates, is_seed, extent)
    cautious = GrowthLimits(
        math.radians(config.iteration_angle),
        config.slope_gain,
        config.iteration_distance,
        config.min_facet_side**2,
    )
    terrain.grow(cautious)
    if config.landform_distance > config.iteration_distance:
        _add_landforms(terrain, candidates, spacing, cautious, config)
    return terrain


def _add_landforms(
    terrain: TerrainGrowth,
    candidates: NDArray[np.float64],
    spacing: float,
    cautious: GrowthLimits,
    config: GroundFilterConfig,
) -> None:
    """Let the terrain grow on over the landforms that the cautious limits left out."""
    height, slope = terrain.height_and_slope()
    ground = near_terrain(height, slope, config)
    trial = terrain.branch()
    trial.grow(
        GrowthLimits(
            math.radians(config.landform_angle),
            config.landform_slope_gain,
            config.landform_distance,
            cautious.squared_side,
        )
    )
    gained = near_terrain(*trial.height_and_slope(), config) & ~ground
    landform, barred = find_landforms(candidates, ground, gained, spacing, config)
    terrain.force(landform)
    terrain.grow(cautious, barred)
