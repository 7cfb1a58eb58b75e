"""Façades and walls: what of a building lies below the edges of its roofs, or is seen without them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.cell_grid import CellGrid
from lidar_buildings.core.stages.roof_selection.candidates import near_in_plan, surroundings

#: A façade lies within this many spacings of its roof's points in plan: an edge is missed by half a spacing.
REACH_SPACINGS = 0.7
#: The same of pulses that go on below: farther out foliage splits them [m].
MAX_SPLIT_REACH = 0.5
#: How far in plan to look for the top of the wall [m].
TOP_REACH = 1.0
#: How far in plan to look for roof around a light well or a dormer's cheek [m], and the sectors of eight that
#: have to show some: one at a straight edge sees it in five.
WELL_REACH = 2.0
MIN_SECTORS = 6
#: Lowest point of a façade above ground, and no less than a spacing: below it is pavement, and planting where
#: points are too far apart to part it from the wall [m].
MIN_HEIGHT = 0.8


def find_facades(
    columns: CellGrid,
    height: NDArray[np.float64],
    is_roof: NDArray[np.bool_],
    is_last: NDArray[np.bool_],
    highest: NDArray[np.float64],
    reach: float,
    spacing: float,
) -> NDArray[np.bool_]:
    """
    Tell which points hang below a roof's edge or beside a wall: windows, what is under eaves, in light wells.

    `columns` holds roof, wall and what can be façade: neither ground nor of a class that stays. `height` is
    above ground, `is_roof` says which points are roof, or wall as large as a building's. What has roof all
    around, or lies farther from roof points than half a metre, counts only if `is_last`, else it is foliage.
    `highest`, shape (n_columns,), is the top within `TOP_REACH` of columns that hold others. `reach` is the
    largest distance from a roof point in plan, 0 for none, and 0.7 `spacing` at least [m].
    """
    if reach <= 0.0 or not is_roof.any():
        return np.zeros(len(height), dtype=bool)
    column, z = columns.cell, columns.points[:, 2]
    far = max(reach, REACH_SPACINGS * spacing)
    can_be = ~is_roof & (height >= max(MIN_HEIGHT, spacing))
    hangs = can_be & (z <= highest[column])
    for own, limit in ((is_last, far), (~is_last, max(reach, min(far, MAX_SPLIT_REACH)))):
        both = columns.select(is_roof | (hangs & own))
        hangs[both.rows] &= near_in_plan(both, is_roof[both.rows], limit)
    del both  # memory
    is_inside = can_be & is_last & ~hangs
    well = surroundings(columns, is_roof, max(WELL_REACH, far), is_inside)
    is_inside &= (well.n_sectors >= MIN_SECTORS)[column] & (z <= well.highest[column])
    return hangs | is_inside


#: How far a wall rises above `min_height`: fences, hedges, lorries and ground floors alone rise less [m].
MIN_RISE = 2.5


def wall_areas(
    points: NDArray[np.float64], label: NDArray[np.int64], min_width: float
) -> NDArray[np.float64]:
    """Return length times height of upright patches [m²], 0 for those too low or short for a building."""
    n = np.bincount(label)
    order = np.lexsort((points[:, 2], label))
    last = np.cumsum(n) - 1
    rise = points[order[last], 2] - points[order[last - n + 1], 2]
    x, y = (away - (np.bincount(label, away) / n)[label] for away in points[:, :2].T)
    xx, yy, xy = (np.bincount(label, one) / n for one in (x * x, y * y, x * y))
    # The variance of an even line is a twelfth of its length's square.
    length = np.sqrt(12.0 * (0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)))
    return np.where((rise >= MIN_RISE) & (length >= min_width), length * rise, 0.0)
