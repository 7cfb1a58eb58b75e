"""Decks: bridges and viaducts, which meet the ground at their own level at two opposite ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.columns import gathered
from lidar_buildings.core.neighbours.sectors import N_SECTORS, sector_of

#: Surfaces and ground are compared in cells of this side [m], or of the side in which areas are counted.
CELL = 1.0
#: How far beyond the end of a surface to look for ground: what is `min_height` above a slope of 1 : 2.5 [m].
REACH = 5.0
#: How far the ground there may lie above or below the end: a kerb, and a road of 5 % over the reach [m].
MAX_STEP = 0.5
#: Share of the cells at either end that have to meet the ground.
MIN_SHARE = 0.6
#: How many times as many cells the sides beside an end have where it is the end of a length: no house on a
#: slope is six times as long up the slope as it is wide.
MIN_LENGTH_TO_WIDTH = 6


def is_deck(
    points: NDArray[np.float64],
    label: NDArray[np.int64],
    n_surfaces: int,
    ground: NDArray[np.float64],
    cell: float,
) -> NDArray[np.bool_]:
    """
    Tell which surfaces go on as ground at their own level, at two ends that face away from each other.

    A house on a slope meets ground at the level of its roof on one side at most. Of a long and narrow surface
    one end is enough, since the other may be hidden or beyond the data. Surfaces are `min_height` or more
    above the ground below them, and fill cells; the order of their points does not matter.
    """
    cell = max(CELL, cell)
    lowest = np.full(n_surfaces, np.inf)
    np.minimum.at(lowest, label, points[:, 2])
    # Most roofs are higher than all the ground, and most ground is lower than the others.
    lowest[lowest > ground[:, 2].max(initial=-np.inf) + MAX_STEP] = np.inf
    is_near = np.flatnonzero(np.isfinite(lowest)[label])
    ground = ground.take(np.flatnonzero(ground[:, 2] >= lowest.min(initial=np.inf) - MAX_STEP), axis=0)
    points, label = points.take(is_near, axis=0), label[is_near]
    columns = gathered(np.vstack([points, ground]), cell)
    owner = np.concatenate([label, np.full(len(ground), -1)])[columns.rows]
    steps = (REACH + cell) / columns.size
    ends, met = np.zeros((2, n_surfaces, N_SECTORS), dtype=np.int64)
    runs = columns.around(REACH + cell)
    _count_ends(columns.points, owner, columns.first, columns.places, runs, steps, ends, met)
    is_end = (met >= MIN_SHARE * ends) & (met > 0)
    opposite, beside = N_SECTORS // 2, N_SECTORS // 4
    sides = np.minimum(np.roll(ends, beside, axis=1), np.roll(ends, -beside, axis=1))
    is_lengthwise = MIN_LENGTH_TO_WIDTH * ends <= sides
    return np.asarray((is_end & (np.roll(is_end, opposite, axis=1) | is_lengthwise)).any(axis=1))


@kernel
def _count_ends(points, owner, first, places, runs, reach, ends, met):  # type: ignore[no-untyped-def]
    """
    Count, by surface and sector, the cells beyond which it does not go on, and those of them with ground.

    A surface is as high in a cell as its highest point there; ground fills all from lowest to highest.
    """
    n = len(places)
    low, high = np.full(n, np.inf), np.full(n, -np.inf)
    start = np.zeros(n + 1, dtype=np.int64)
    own, top = np.empty(len(points), dtype=np.int64), np.empty(len(points))
    entry = np.full(len(ends), -1, dtype=np.int64)
    total = 0
    for k in range(n):
        for i in range(first[k], first[k + 1]):
            z = points[i, 2]
            if owner[i] < 0:
                low[k], high[k] = min(low[k], z), max(high[k], z)
            elif entry[owner[i]] < start[k]:
                entry[owner[i]], own[total], top[total] = total, owner[i], z
                total += 1
            else:
                top[entry[owner[i]]] = max(top[entry[owner[i]]], z)
        start[k + 1] = total
    for k in range(n):
        for one in range(start[k], start[k + 1]):
            goes_on, is_met = 0, 0
            for row in range(runs.shape[1]):
                for c in range(runs[k, row, 0], runs[k, row, 1]):
                    dx, dy = places[c, 1] - places[k, 1], places[c, 0] - places[k, 0]
                    if c == k or dx * dx + dy * dy > reach * reach:
                        continue
                    bit = 1 << sector_of(dx, dy)
                    if low[c] - MAX_STEP <= top[one] <= high[c] + MAX_STEP:
                        is_met |= bit
                    for other in range(start[c], start[c + 1]):
                        if own[other] == own[one]:
                            goes_on |= bit
            for sector in range(N_SECTORS):
                if not goes_on >> sector & 1:
                    ends[own[one], sector] += 1
                    met[own[one], sector] += is_met >> sector & 1
