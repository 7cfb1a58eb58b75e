"""Landforms or objects: what may be ground is judged part by part, by its links to the terrain."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.growing_tin.candidate_links import (
    level_parts,
    nearest_by_sector,
    rise_and_length,
)

# These and the rules below were chosen with `bench.ground.isprs` and `bench.ground.scenes`.
#: How far neighbours may be, in spacings of the candidates.
REACH = 3.0
#: Share of objects around up to which terrain is open, and from which on it is not at all.
OPEN_SHARE, BUILT_SHARE = 0.04, 0.15
#: Side of the cells that are counted [m], and the number of them around: `bench.ground.isprs` and `.scenes`.
CELL, RADIUS = 10.0, 6


class PartRules(NamedTuple):
    """What makes parts, and when they are terrain or certainly not."""

    max_link_slope: float = 0.7  #: points of one part rise by no more than this over their distance in plan
    #: A link is steep if it rises by more than this over its length: walls do, banks do not.
    steep_slope: float = 0.85
    #: Smallest part that is judged as a whole, among objects and in open terrain [candidates].
    min_part: float = 15.0
    min_open_part: float = 2.0
    #: Parts with at least this share of steep links, of at least so many candidates, are excluded.
    excluded_share: float = 0.7
    min_excluded_part: float = 50.0


def find_landforms(
    candidates: NDArray[np.float64],
    ground: NDArray[np.bool_],
    gained: NDArray[np.bool_],
    spacing: float,
    config: GroundFilterConfig,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """
    Tell which of the gained candidates are of the terrain, and which are certainly not.

    Neighbours that are gained and nearly level make up a part. Its links to the ground decide: banks, mounds
    and terraces meet it under slopes, walls in steps (Sithole & Vosselman 2005 judge segments in this way).
    How many steps are allowed depends on the density of objects: in open terrain, what rises from it is
    likely to be terrain.

    Parameters
    ----------
    candidates : ndarray of shape (n_candidates, 3)
        At most one per place [m].
    ground, gained : ndarray of shape (n_candidates,), bool
        What is ground without doubt, and what may be as well.
    spacing : float
        Spacing of the candidates [m].
    config : GroundFilterConfig
        Shares.

    Returns
    -------
    landform, excluded : ndarray of shape (n_candidates,), bool
        Parts of `gained`.
    """
    rows = np.flatnonzero(gained)
    links = nearest_by_sector(candidates, rows, REACH * spacing)
    density = object_density(candidates, ~(ground | gained))[rows]
    openness = np.clip((BUILT_SHARE - density) / (BUILT_SHARE - OPEN_SHARE), 0.0, 1.0)
    rules = PartRules()
    part = level_parts(candidates, rows, links, rules.max_link_slope)
    counts = _count_links(candidates, rows, links, ground, part, rules)
    kept, certain = _judge(counts, np.bincount(part, openness, len(rows)).astype(np.float64), config, rules)
    landform, excluded = np.zeros_like(ground), np.zeros_like(ground)
    landform[rows] = kept[part]
    excluded[rows] = certain[part]
    return landform, excluded


def _judge(
    counts: NDArray[np.float64], openness: NDArray[np.float64], config: GroundFilterConfig, rules: PartRules
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    size, n_links, n_steep = counts.T
    is_open = openness / np.maximum(size, 1.0)
    allowed = config.max_steep_share + is_open * (config.max_open_steep_share - config.max_steep_share)
    large = size >= rules.min_part + is_open * (rules.min_open_part - rules.min_part)
    kept = large & (n_links > 0.0) & (n_steep <= allowed * n_links)
    walled = n_steep >= rules.excluded_share * np.maximum(n_links, 1.0)
    return kept, ~kept & walled & (size >= rules.min_excluded_part)


@kernel
def _count_links(candidates, rows, links, ground, part, rules):  # type: ignore[no-untyped-def]
    """Return each part's size, its links to the ground, and how many of them are steep."""
    counts = np.zeros((len(rows), 3))
    for r in range(len(rows)):
        count = counts[part[r]]
        count[0] += 1.0
        for j in links[r]:
            if j < 0 or not ground[j]:
                continue
            rise, length = rise_and_length(candidates[j], candidates[rows[r]])
            count[1] += 1.0
            count[2] += 1.0 if rise > rules.steep_slope * length else 0.0
    return counts


def object_density(candidates: NDArray[np.float64], is_object: NDArray[np.bool_]) -> NDArray[np.float64]:
    """
    Return the share of objects among the candidates around each, 0 to 1.

    Cells up to 60 m away along x and y count with Gaussian weights (σ = 30 m).
    """
    cells = sort_by_cell(candidates, CELL)
    n_objects = np.add.reduceat(is_object[cells.rows].astype(np.float64), cells.first[:-1])
    n_all = np.diff(cells.first).astype(np.float64)
    share = np.divide(*_smoothed(cells.numbers, cells.n_columns, np.stack((n_objects, n_all))))
    density = np.empty(len(candidates))
    density[cells.rows] = np.repeat(share, np.diff(cells.first))
    return density


def _smoothed(numbers: NDArray[np.int64], n_columns: int, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return the weighted sums of values (k, n_cells) over the cells around; only occupied cells take part.
    """
    total, column = np.zeros_like(values), numbers % n_columns
    for north in range(-RADIUS, RADIUS + 1):
        for east in range(-RADIUS, RADIUS + 1):
            wanted = numbers + (north * n_columns + east)
            place = np.minimum(np.searchsorted(numbers, wanted), len(numbers) - 1)
            is_there = (numbers[place] == wanted) & (column + east >= 0) & (column + east < n_columns)
            weight = math.exp(-2.0 * (north * north + east * east) / RADIUS**2)
            total[:, is_there] += weight * values[:, place[is_there]]
    return total
