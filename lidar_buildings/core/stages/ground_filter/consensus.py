"""Method `consensus`: the lowest points of cells, judged in three ways that do not know of one another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.stages.ground_filter import morphological
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.growing_tin.landforms import find_landforms
from lidar_buildings.core.stages.ground_filter.growing_tin.progressive_tin import label_candidates
from lidar_buildings.core.stages.ground_filter.plates import NO_EXTENTS, find_plates
from lidar_buildings.core.stages.ground_filter.scan_profiles import bidirectional_slope


def agreed_ground(
    candidates: NDArray[np.float64], extent: NDArray[np.float64], spacing: float, config: GroundFilterConfig
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """
    Return which candidates are landforms, or ground to two of three views, but for wide roofs; else all.

    Beside them the extents of what may be a wide roof as well, see `Plates.cut_off`.

    A TIN that grows (Axelsson 2000) fails where its seeds do, profiles (Shan and Sampath 2005) where they
    meet no ground on their way, openings (Zhang et al. 2003) where the terrain is as narrow as an object.
    What one of them gets wrong, the two others seldom do; weights that are fitted to them come out equal.
    Parts that one view alone calls ground are landforms if they meet the ground agreed on as terrain does,
    but for what the TIN climbs without wider limits, such as decks of bridges.
    Roofs wider than the first terrain's cells and the windows of the others are found by their walls.

    Parameters
    ----------
    candidates : ndarray of shape (n_candidates, 3)
        At least one; at most one per place, gross errors removed, in an order that puts neighbours
        together [m].
    extent : ndarray of shape (2, 2)
        Lower left and upper right corner of what the terrain has to cover [m].
    spacing : float
        Of the candidates [m].
    config : GroundFilterConfig
        The parameters of all three methods.
    """
    votes = np.zeros((3, len(candidates)), dtype=np.int8)
    beyond = np.zeros(len(candidates), dtype=np.bool_)

    def grow() -> NDArray[np.bool_]:
        ground, beyond[:] = label_candidates(candidates, extent, spacing, config)
        return ground

    views = (
        grow,
        lambda: bidirectional_slope.label_candidates(candidates, spacing, config),
        lambda: morphological.label_ground(candidates, config),
    )

    def look(begin: int, end: int) -> None:
        for k in range(begin, end):
            votes[k] = views[k]()

    for_row_blocks(look, len(views), 1)
    n_votes = votes.sum(axis=0)
    ground = n_votes >= 2
    if not ground.any():
        return np.ones_like(ground), NO_EXTENTS
    ground |= find_landforms(candidates, ground, beyond & (n_votes == 1), spacing, config)[0]
    plates = find_plates(candidates, ground, spacing)
    return ground & ~plates.on_roof, plates.cut_off
