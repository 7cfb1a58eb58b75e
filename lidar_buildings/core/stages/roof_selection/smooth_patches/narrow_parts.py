"""What is too narrow on its level: vehicles, alone or at a dock, hedges, balconies and awnings."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.columns import Columns
from lidar_buildings.core.surfaces.morphology import square_distances

#: Roofs that no step of half a storey connects are of different levels [m].
LEVEL_STEP = 1.2
#: Largest part that may be a vehicle or a hedge [m²]: larger ones as narrow are longer than 100 m.
MAX_NARROW_AREA = 300.0
#: Cells across the narrowest building, and across the narrowest part of a roof: fewer are too coarse to tell.
MIN_BUILDING_CELLS, MIN_PART_CELLS = 2.0, 5.0
#: Share of a part's rim beside other roofs, up to which it only touches them: a lorry's end, not a lean-to's
#: side; and how far from the rim they may be [m].
MAX_CONTACT = 0.2
CONTACT_REACH = 1.0


class _Window(NamedTuple):
    """
    A part: its points' rows, their places in a window around it, and three plans of that.

    The plans show roofs no higher than the part's top, the part itself, and others.
    """

    rows: NDArray[np.intp]
    place: tuple[NDArray[np.int32], NDArray[np.int32]]
    below: NDArray[np.uint8]
    own: NDArray[np.uint8]
    others: NDArray[np.uint8]


def of_buildings(
    columns: Columns, part: NDArray[np.int64], area: NDArray[np.float64], min_width: float
) -> NDArray[np.bool_]:
    """
    Tell which points are of parts somewhere as wide as a building, or leaning on others.

    Parameters
    ----------
    columns : Columns
        Points of roofs; no narrower than a spacing, else a roof is full of gaps [m].
    part : ndarray of int64, shape (n_points,)
        What steps of less than a level connect.
    area : ndarray of shape (n_parts,)
        In plan [m²].
    min_width : float
        Of buildings [m]; one below `MIN_BUILDING_CELLS` columns says nothing, and all pass.
    """
    kept = np.ones(len(part), dtype=bool)
    if min_width < MIN_BUILDING_CELLS * columns.size:
        return kept
    reach = math.ceil(0.5 * min_width / columns.size + 0.5)
    for one in _windows(columns, part, area < MAX_NARROW_AREA, reach):
        deepest = math.sqrt(square_distances(closed(one.below), 0, reach)[one.place].max())
        if (2.0 * deepest - 1.0) * columns.size < min_width:
            kept[one.rows] = _contact(one.own, one.others, columns.size) > MAX_CONTACT
    return kept


def wide_enough(
    columns: Columns, part: NDArray[np.int64], is_judged: NDArray[np.bool_], min_width: float
) -> NDArray[np.bool_]:
    """
    Tell which points a disc covers that lies within their part and what is no higher than its top.

    An opening: a dormer stands on the roof around it, a balcony on nothing.

    Parameters
    ----------
    columns, part
        As for `of_buildings`.
    is_judged : ndarray of bool, shape (n_parts,)
        For which parts to ask; all points of others pass.
    min_width : float
        Diameter of the disc [m]; one below `MIN_PART_CELLS` columns says nothing, and all pass.
    """
    kept = np.ones(len(part), dtype=bool)
    half = 0.5 * min_width / columns.size
    if half < 0.5 * MIN_PART_CELLS:
        return kept
    reach = math.ceil(half)
    for one in _windows(columns, part, is_judged, reach):
        kept[one.rows] = opened(square_distances(closed(one.below), 0, reach), half)[one.place]
    return kept


def _windows(
    columns: Columns, part: NDArray[np.int64], is_judged: NDArray[np.bool_], reach: int
) -> Iterator[_Window]:
    """Go through the parts that are judged."""
    chosen = np.flatnonzero(is_judged[part])
    chosen = chosen[np.argsort(part[chosen], kind="stable")]
    begins = np.flatnonzero(np.diff(part[chosen], prepend=-1))
    for rows in np.split(chosen, begins[1:]) if len(chosen) else ():
        cells = columns.places[columns.column[rows]]
        low = cells.min(axis=0) - (2 * reach + 4)
        y, x = (cells - low).T
        shape = (y.max() + 2 * reach + 5, x.max() + 2 * reach + 5)
        count, (below, others) = np.zeros(shape, np.int32), np.zeros((2, *shape), np.uint8)
        np.add.at(count, (y, x), 1)
        line, held = _columns_within(columns, low, shape)
        place = (line, columns.places[held, 1] - low[1])
        below[place] = columns.points[columns.first[held], 2] <= columns.points[rows, 2].max()
        others[place] = columns.first[held + 1] - columns.first[held] > count[place]
        yield _Window(rows, (y, x), below, (count > 0).astype(np.uint8), others)


def _contact(own: NDArray[np.uint8], others: NDArray[np.uint8], size: float) -> float:
    """Return which share of a part's rim lies beside other roofs."""
    plan = closed(own)
    inner = plan[:-2, 1:-1] & plan[2:, 1:-1] & plan[1:-1, :-2] & plan[1:-1, 2:]
    rim = plan[1:-1, 1:-1] > inner
    reach = CONTACT_REACH / size
    return float((square_distances(others, 1, math.ceil(reach))[1:-1, 1:-1][rim] <= reach**2).mean())


def _columns_within(
    columns: Columns, low: NDArray[np.integer], shape: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the columns with points in a window of places, line by line, and their lines in it."""
    start = (np.arange(shape[0]) + int(low[0])) * columns.row_length
    west, east = max(int(low[1]), 0), min(int(low[1]) + shape[1], columns.row_length)
    begin, end = np.searchsorted(columns.numbers, (start + west, start + east))
    n = end - begin
    line = np.repeat(np.arange(shape[0]), n)
    within = np.arange(len(line)) + np.repeat(begin - (np.cumsum(n) - n), n)
    is_held = columns.first[within + 1] > columns.first[within]
    return line[is_held], within[is_held]


def opened(depth: NDArray[np.int32], half: float) -> NDArray[np.bool_]:
    """Tell which cells a disc within the plan covers: its radius in cells, squared depths given."""
    core = (depth >= half**2).astype(np.uint8)
    return np.asarray(square_distances(core, 1, math.ceil(half + 1.0)) <= (half + 1.0) ** 2)


@kernel
def closed(plan):  # type: ignore[no-untyped-def]
    """Return a plan with cells filled that are empty by chance: gaps of few cells."""
    n, m = plan.shape
    grown, found = np.zeros((n, m), dtype=np.uint8), plan.copy()
    for i in range(1, n - 1):
        for j in range(1, m - 1):
            middle = plan[i, j - 1] | plan[i, j] | plan[i, j + 1]
            north = plan[i + 1, j - 1] | plan[i + 1, j] | plan[i + 1, j + 1]
            grown[i, j] = middle | north | plan[i - 1, j - 1] | plan[i - 1, j] | plan[i - 1, j + 1]
    for i in range(1, n - 1):
        for j in range(1, m - 1):
            middle = grown[i, j - 1] & grown[i, j] & grown[i, j + 1]
            north = grown[i + 1, j - 1] & grown[i + 1, j] & grown[i + 1, j + 1]
            found[i, j] |= middle & north & grown[i - 1, j - 1] & grown[i - 1, j] & grown[i - 1, j + 1]
    return found
