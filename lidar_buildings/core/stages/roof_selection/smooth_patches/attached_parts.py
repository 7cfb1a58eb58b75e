"""What is too narrow on its level: balconies and awnings, and vehicles, alone or at a dock."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.columns import Columns
from lidar_buildings.core.neighbours.windows import first_from
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.smooth_patches.narrow_parts import MIN_CELLS, closed, opened
from lidar_buildings.core.surfaces.morphology import square_distances

#: Roofs that no step of half a storey connects are of different levels [m].
LEVEL_STEP = 1.2
#: Largest part that may be a vehicle or a hedge [m²]: larger ones as narrow are longer than 100 m.
MAX_NARROW_AREA = 300.0
#: Columns across the narrowest building: fewer are too coarse to tell.
MIN_BUILDING_CELLS = 2.0
#: Share of a part's rim beside other roofs, up to which it only touches them: a lorry's end, not a lean-to's
#: side; and how far from the rim they may be [m].
MAX_CONTACT = 0.2
CONTACT_REACH = 1.0


def wide_levels(
    columns: Columns,
    part: NDArray[np.int64],
    area: NDArray[np.float64],
    config: RoofSelectionConfig,
    *,
    is_bare: bool = False,
) -> NDArray[np.bool_]:
    """
    Tell which roof points are of parts that are wide enough by themselves, or with what they stand on.

    A part is what steps of less than a level connect. Of those below `max_part_area` what is narrower than
    `min_roof_width` goes; those that stand alone or only touch other roofs go if they are nowhere as wide as
    `min_building_width`. Of bare roofs, which have not taken in yet what stands on them, only parts that
    touch others are judged, by their width as buildings: all may be wider than they seem.
    """
    kept = np.ones(len(part), dtype=bool)
    size = columns.size
    # Of what is too coarse to be measured nothing is too narrow.
    max_opened = config.max_part_area if not is_bare and config.min_roof_width >= MIN_CELLS * size else 0.0
    min_width = config.min_building_width if config.min_building_width >= MIN_BUILDING_CELLS * size else 0.0
    chosen = np.flatnonzero((area < max(MAX_NARROW_AREA, max_opened))[part])
    chosen = chosen[np.argsort(part[chosen], kind="stable")]
    if len(chosen) == 0:
        return kept
    begins = np.flatnonzero(np.diff(part[chosen], prepend=-1))
    half = 0.5 * config.min_roof_width / size
    reach = math.ceil(max(half, 0.5 * min_width / size + 0.5))
    places = columns.places[columns.column[chosen]]
    lows = np.minimum.reduceat(places, begins) - (2 * reach + 4)
    shapes = np.maximum.reduceat(places, begins) - lows + (2 * reach + 5)
    tops = np.maximum.reduceat(columns.points[chosen, 2], begins)
    plan = (columns.points, columns.first, columns.numbers, columns.row_length)
    cut = np.append(begins, len(chosen))
    for start, end, low, shape, top in zip(cut[:-1], cut[1:], lows, shapes, tops, strict=True):
        rows, (y, x) = chosen[start:end], (places[start:end] - low).T
        own, (below, others) = np.zeros(shape, np.int32), np.zeros((2, *shape), np.uint8)
        _draw(*plan, y, x, low, top, own, below, others)
        if is_bare and not others.any():
            continue
        depth = square_distances(closed(below), 0, reach)
        if area[part[rows[0]]] < max_opened:
            kept[rows] = opened(depth, half)[y, x]
        width = 2.0 * (math.sqrt(depth[y, x].max()) - 0.5) * size
        if width < min_width and kept[rows].any():
            contact = _contact(own, others, size)
            kept[rows] &= contact > MAX_CONTACT or (is_bare and contact == 0.0)
    return kept


def _contact(own: NDArray[np.int32], others: NDArray[np.uint8], size: float) -> float:
    """Return which share of a part's rim lies beside other roofs."""
    plan = closed((own > 0).astype(np.uint8))
    inner = plan[:-2, 1:-1] & plan[2:, 1:-1] & plan[1:-1, :-2] & plan[1:-1, 2:]
    rim = plan[1:-1, 1:-1] > inner
    reach = CONTACT_REACH / size
    return float((square_distances(others, 1, math.ceil(reach))[1:-1, 1:-1][rim] <= reach**2).mean())


@kernel
def _draw(points, first, numbers, row_length, y, x, low, top, own, below, others):  # type: ignore[no-untyped-def]
    """Count a part's points in a window of places; mark what is no higher than its top, and other roofs."""
    for i in range(len(y)):
        own[y[i], x[i]] += 1
    west, east = max(low[1], 0), min(low[1] + own.shape[1], row_length)
    for line in range(len(own)):
        start = (low[0] + line) * row_length
        k = first_from(numbers, start + west)
        while k < len(numbers) and numbers[k] < start + east:
            place = numbers[k] - start - low[1]
            if first[k + 1] > first[k]:
                below[line, place] = points[first[k], 2] <= top
                others[line, place] = first[k + 1] - first[k] > own[line, place]
            k += 1
