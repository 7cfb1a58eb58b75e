"""What is attached to a building at another level, and too narrow: balconies, awnings, lorries at a dock."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.smooth_patches.narrow_parts import closed, opened, to_edge
from lidar_buildings.core.surfaces.surface_patches import connected_parts, plan_areas

#: Roofs that no step of half a storey connects are of different levels [m].
LEVEL_STEP = 1.2
#: How much higher than a part may be what it stands on: a lower roof makes a dormer or a parapet wide [m].
TOLERANCE = 0.5
#: Largest part that may be a vehicle: four lorries side by side [m²].
MAX_VEHICLES = 150.0
#: Share of a part's rim beside other roofs, up to which it only touches them: a lorry's end, not a lean-to's
#: side; and how far from the rim they may be [m].
MAX_CONTACT = 0.2
CONTACT_REACH = 1.0
#: Side of the blocks in which roofs around a part are found [m].
BLOCK = 16.0


def wide_levels(
    points: NDArray[np.float64], radius: float, cell: float, config: RoofSelectionConfig
) -> NDArray[np.bool_]:
    """
    Tell which roof points are of parts that are wide enough by themselves, or with what they stand on.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        Of roofs, in any order [m].
    radius : float
        Longest step within a part, if more than half a storey [m].
    cell : float
        Side of the cells in which widths are measured [m].
    config : RoofSelectionConfig
        `max_part_area`: of smaller parts what is narrower than `min_roof_width` goes. Parts that only touch
        other roofs go if they are nowhere as wide as `min_building_width`.
    """
    kept = np.ones(len(points), dtype=bool)
    if len(points) == 0 or config.min_roof_width < 2.0 * cell:
        return kept
    part = connected_parts(points, max(LEVEL_STEP, radius))
    area = plan_areas(points, part, cell)
    largest = max(MAX_VEHICLES, config.max_part_area)
    cells = np.floor(points[:, :2] / cell).astype(np.int64)
    margin = math.ceil(max(2.0 * config.min_building_width, CONTACT_REACH) / cell) + 3
    for number, own, near in _with_surroundings(cells, part, area < largest, margin, BLOCK / cell):
        low = cells[own].min(axis=0) - margin
        shape = cells[own].max(axis=0) + margin + 1 - low
        below = near[points[near, 2] <= points[own, 2].max() + TOLERANCE]
        at = tuple((cells[own] - low).T)
        depth = to_edge(closed(_plan(cells[below] - low, shape)))
        if area[number] < config.max_part_area:
            kept[own] = opened(depth, config.min_roof_width / cell)[at]
        if 2.0 * (depth[at].max() - 0.5) * cell < config.min_building_width:
            others = _plan(cells[near[part[near] != number]] - low, shape)
            kept[own] &= _contact(_plan(cells[own] - low, shape), others, cell) > MAX_CONTACT
    return kept


def _with_surroundings(
    cells: NDArray[np.int64],
    part: NDArray[np.int64],
    chosen: NDArray[np.bool_],
    margin: int,
    block: float,
) -> Iterator[tuple[int, NDArray[np.int64], NDArray[np.int64]]]:
    """Go through the chosen parts: number, rows, rows within their bounds and a margin of cells."""
    rows_of_part = np.split(np.argsort(part, kind="stable"), np.cumsum(np.bincount(part))[:-1])
    blocks, inverse, count = np.unique(
        np.floor(cells / block).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    rows = np.split(np.argsort(inverse.ravel(), kind="stable"), np.cumsum(count)[:-1])
    rows_of_block = dict(zip(map(tuple, blocks.tolist()), rows, strict=True))
    for number in np.flatnonzero(chosen):
        own = rows_of_part[number]
        low, high = cells[own].min(axis=0) - margin, cells[own].max(axis=0) + margin
        (x, y), (end_x, end_y) = (np.floor(corner / block).astype(int) for corner in (low, high))
        around = [(i, j) for i in range(x, end_x + 1) for j in range(y, end_y + 1)]
        near = np.concatenate([rows_of_block[place] for place in around if place in rows_of_block])
        yield int(number), own, near[((cells[near] >= low) & (cells[near] <= high)).all(axis=1)]


def _plan(cells: NDArray[np.int64], shape: NDArray[np.int64]) -> NDArray[np.bool_]:
    plan = np.zeros(shape, dtype=bool)
    plan[tuple(cells.T)] = True
    return plan


def _contact(own: NDArray[np.bool_], others: NDArray[np.bool_], cell: float) -> float:
    """Return which share of a part's rim lies beside other roofs."""
    if not others.any():
        return 0.0
    own = closed(own)
    rim = own & ~ndimage.binary_erosion(own)
    is_near = ndimage.distance_transform_edt(~others)[rim] * cell <= CONTACT_REACH
    return float(is_near.mean())
