"""What is attached to a building at another level, and too narrow: balconies, awnings, lorries at a dock."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.columns import Columns
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.smooth_patches.narrow_parts import closed, square_distances

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


def wide_levels(
    columns: Columns, part: NDArray[np.int64], area: NDArray[np.float64], config: RoofSelectionConfig
) -> NDArray[np.bool_]:
    """
    Tell which roof points are of parts that are wide enough by themselves, or with what they stand on.

    Parameters
    ----------
    columns : Columns
        Points of roofs [m].
    part : ndarray of int64, shape (n_points,)
        What steps of less than a level connect.
    area : ndarray of shape (n_parts,)
        In plan [m²].
    config : RoofSelectionConfig
        `max_part_area`: of smaller parts what is narrower than `min_roof_width` goes. Parts that only touch
        other roofs go if they are nowhere as wide as `min_building_width`.
    """
    kept = np.ones(len(part), dtype=bool)
    if config.min_roof_width < 2.0 * columns.size:
        return kept
    chosen = np.flatnonzero((area < max(MAX_VEHICLES, config.max_part_area))[part])
    if len(chosen) == 0:
        return kept
    chosen = chosen[np.argsort(part[chosen], kind="stable")]
    begins = np.flatnonzero(np.diff(part[chosen], prepend=-1, append=-1))
    _judge(
        columns.points,
        columns.first,
        columns.numbers,
        columns.places,
        columns.row_length,
        columns.column[chosen],
        chosen,
        begins,
        (area < config.max_part_area)[part[chosen[begins[:-1]]]],
        columns.size,
        0.5 * config.min_roof_width / columns.size,
        config.min_building_width,
        kept,
    )
    return kept


@njit(cache=True, nogil=True)
def _judge(  # type: ignore[no-untyped-def]
    points, first, numbers, places, row_length, column, rows, begins, is_part, size, half, min_width, kept
):
    """Judge part after part, each in a window of its own."""
    reach = math.ceil(max(half, 0.5 * min_width / size + 0.5))
    near = math.ceil(CONTACT_REACH / size)
    margin = 2 * reach + 4
    for k in range(len(begins) - 1):
        begin, end = begins[k], begins[k + 1]
        low_x, high_x, low_y, high_y, top = row_length, 0, numbers[-1], 0, -np.inf
        for i in range(begin, end):
            y, x = places[column[i], 0], places[column[i], 1]
            low_x, high_x, low_y, high_y = min(low_x, x), max(high_x, x), min(low_y, y), max(high_y, y)
            top = max(top, points[rows[i], 2])
        low_x, high_x, low_y, high_y = low_x - margin, high_x + margin, low_y - margin, high_y + margin
        below = np.zeros((high_y - low_y + 1, high_x - low_x + 1), dtype=np.uint8)
        own, others = np.zeros_like(below), np.zeros_like(below)
        count = np.zeros(below.shape, dtype=np.int64)
        for i in range(begin, end):
            y, x = places[column[i], 0] - low_y, places[column[i], 1] - low_x
            own[y, x] = 1
            count[y, x] += 1
        for y in range(low_y, high_y + 1):
            c = np.searchsorted(numbers, y * row_length + max(low_x, 0))
            last = y * row_length + min(high_x, row_length - 1)
            while c < len(numbers) and numbers[c] <= last:
                x = numbers[c] - y * row_length - low_x
                n = first[c + 1] - first[c]
                below[y - low_y, x] = n > 0 and points[first[c], 2] <= top + TOLERANCE
                others[y - low_y, x] = n > count[y - low_y, x]
                c += 1
        depth = square_distances(closed(below), 0, reach)
        widest = 0
        for y in range(len(own)):
            for x in range(own.shape[1]):
                if own[y, x]:
                    widest = max(widest, depth[y, x])
        if is_part[k]:
            core = (depth >= half * half).astype(np.uint8)
            to_core = square_distances(core, 1, math.ceil(half + 1.0))
            for i in range(begin, end):
                y, x = places[column[i], 0] - low_y, places[column[i], 1] - low_x
                kept[rows[i]] = to_core[y, x] <= (half + 1.0) ** 2
        if 2.0 * (math.sqrt(widest) - 0.5) * size < min_width:
            to_others = square_distances(others, 1, near)
            if _contact(closed(own), to_others, (CONTACT_REACH / size) ** 2) <= MAX_CONTACT:
                for i in range(begin, end):
                    kept[rows[i]] = False


@njit(cache=True, nogil=True)
def _contact(own, to_others, square):  # type: ignore[no-untyped-def]
    """Return which share of a part's rim lies beside other roofs."""
    rim, beside = 0, 0
    for y in range(1, len(own) - 1):
        for x in range(1, own.shape[1] - 1):
            inner = own[y - 1, x] & own[y + 1, x] & own[y, x - 1] & own[y, x + 1]
            if own[y, x] and not inner:
                rim += 1
                beside += to_others[y, x] <= square
    return beside / rim
