"""From where strips were seen: from above, or from the street."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import View
from lidar_buildings.core.neighbours.point_spacing import FINEST

#: Side of the cells in which points are counted, and height of the levels at which they are noted [m].
CELL, LEVEL = 2.0, 0.5
#: From the street the ground beside the scanner is a hundred times as dense as what is 30 m away. Half of the
#: points of 60 strips from above, forests and double pulses among them, lie in cells at most 2.2 times as
#: dense as the middle of the area.
MIN_UNEVEN = 6.0
#: A clip of a street may be even: half of its points are where they are as dense [1/m²] as no aircraft
#: measures, and most in cells that hold points at so many levels, on walls.
MIN_DENSE, MIN_STACKED, STACKED_LEVELS = 400.0, 0.8, 6
#: Strips with fewer points or cells tell nothing of themselves.
MIN_POINTS, MIN_CELLS = 500, 10
#: A strip is one number within an hour: files that were merged may have one number for all.
_SECONDS = 3600.0
#: Multipliers that spread columns and rows over 64 bits (Steele, Lea, Flood, 2014).
_SPREAD = np.array([0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9], dtype=np.uint64)

#: What is counted of a strip in a cell; `levels` has a bit for each level, of 64 in turns, with a point.
COUNTED = np.dtype([("strip", "<i8"), ("column", "<i4"), ("row", "<i4"), ("count", "<i8"), ("levels", "<u8")])


def strip_numbers(
    point_source_id: NDArray[np.integer] | None, gps_time: NDArray[np.float64] | None, n_points: int
) -> NDArray[np.int64]:
    """Return the strip of each point: its source's number, and the hour if times are known (not NaN)."""
    strip = np.zeros(n_points, dtype=np.int64)
    if point_source_id is not None:
        strip += point_source_id
    if gps_time is not None:
        strip += np.nan_to_num(np.floor(gps_time / _SECONDS)).astype(np.int64) << 16
    return strip


def count_cells(points: NDArray[np.float64], strip: NDArray[np.int64], step: int = 1) -> NDArray[Any]:
    """Count points (n, 3) [m] by strip and cell, `COUNTED`; of one cell in `step`, always the same ones."""
    places = np.floor(points[:, :2] / CELL).astype(np.int64)
    if step > 1:
        spread = (places.astype(np.uint64) * _SPREAD).sum(axis=1) >> np.uint64(32)
        rows = np.flatnonzero(spread % np.uint64(step) == 0)
        points, places, strip = points[rows], places[rows], strip[rows]
    found = np.empty(len(points), COUNTED)
    found["strip"], found["count"] = strip, 1
    found["column"], found["row"] = np.clip(places, -(2**31), 2**31 - 1).T
    level = np.floor(points[:, 2] / LEVEL).astype(np.int64) % 64
    found["levels"] = np.uint64(1) << level.astype(np.uint64)
    return joined_counts([found])


def joined_counts(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Return counts with a row for each strip and cell."""
    rows = np.concatenate([np.empty(0, COUNTED), *parts])
    if not len(rows):
        return rows
    rows = rows[np.lexsort((rows["row"], rows["column"], rows["strip"]))]
    place = rows[["strip", "column", "row"]]
    first = np.flatnonzero(np.concatenate([[True], place[1:] != place[:-1]]))
    found = rows[first]
    found["count"] = np.add.reduceat(rows["count"], first)
    found["levels"] = np.bitwise_or.reduceat(rows["levels"], first)
    return found


def views_of_counts(counts: NDArray[Any]) -> dict[int, View]:
    """
    Tell from where each strip was seen, by what `joined_counts` returns.

    From above a strip is even; from the street its density falls with the distance from the scanner. A strip
    of few points is as most others.
    """
    numbers, first = np.unique(counts["strip"], return_index=True)
    groups = np.split(counts, first[1:]) if len(numbers) else []
    views = {int(number): _view_of(group) for number, group in zip(numbers, groups, strict=True)}
    n_of = {View.ABOVE: 0, View.STREET: 0, View.UNKNOWN: 0}
    for view, group in zip(views.values(), groups, strict=True):
        n_of[view] += int(group["count"].sum())
    most = View.STREET if n_of[View.STREET] > n_of[View.ABOVE] else View.ABOVE
    return {number: view or most for number, view in views.items()}


def strip_views(points: NDArray[np.float64], strip: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Return the `View` of points (n, 3) [m], by the strips that they are of."""
    views = views_of_counts(count_cells(points, strip))
    numbers, place = np.unique(strip, return_inverse=True)
    of_number = np.array([views[int(one)] for one in numbers], dtype=np.uint8)
    return np.asarray(of_number[place.reshape(-1)])


def _view_of(counts: NDArray[Any]) -> View:
    n = np.sort(counts["count"])
    total = int(n.sum())
    if total < MIN_POINTS or len(n) < MIN_CELLS:
        return View.UNKNOWN
    of_area, of_points = n[len(n) // 2], n[np.searchsorted(np.cumsum(n), 0.5 * total)]
    if of_points >= MIN_UNEVEN * of_area:
        return View.STREET
    bits = np.unpackbits(np.ascontiguousarray(counts["levels"]).view(np.uint8)).reshape(-1, 64)
    on_walls = counts["count"][bits.sum(axis=1) >= STACKED_LEVELS].sum()
    is_clip = of_points >= MIN_DENSE * CELL**2 and on_walls >= MIN_STACKED * total
    return View.STREET if is_clip else View.ABOVE


#: A place was seen from above if points from there lie within this distance in plan: holes in roofs that are
#: wet or dark are narrower [m], and where points are sparse so many spacings.
NEAR, NEAR_SPACINGS = 2.0, 4.0


def with_covered(points: NDArray[np.float64], view: NDArray[np.uint8], spacing: float) -> NDArray[np.uint8]:
    """
    Return views with what was seen from the street `COVERED` at places that were seen from above, else not.

    `points` (n, 3) [m]; `spacing` is that of the points from above [m].
    """
    is_street = view >= View.STREET
    found = np.where(is_street, View.STREET, view).astype(np.uint8)
    rows = np.flatnonzero(is_street)
    if not len(rows) or len(rows) == len(view):
        return found
    reach = max(NEAR, NEAR_SPACINGS * max(spacing, FINEST))
    above = np.unique(_numbers(points[~is_street], reach))
    places, place = np.unique(_numbers(points[rows], reach), return_inverse=True)
    is_near = np.zeros(len(places), dtype=bool)
    for east in (-1, 0, 1):
        for north in (-1, 0, 1):
            beside = places + east * _ROW + north
            at = np.minimum(np.searchsorted(above, beside), len(above) - 1)
            is_near |= above[at] == beside
    found[rows[is_near[place.reshape(-1)]]] = View.COVERED
    return found


#: By how much the number of a cell's eastern neighbour is higher: more rows than any map has.
_ROW = 2**31


def _numbers(points: NDArray[np.float64], size: float) -> NDArray[np.int64]:
    column, row = np.floor(points[:, :2] / size).astype(np.int64).T
    return np.asarray(column * _ROW + row)
