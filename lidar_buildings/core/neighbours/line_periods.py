"""Scan lines told from the points alone: the direction across which they repeat, and their distance."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import CellGrid

#: Displacements are counted up to this along x and y, in squares of that side [spacings].
REACH, BIN = 2.5, 0.2
#: Directions that are tried, and distances of lines [spacings].
N_DIRECTIONS = 60
DISTANCES = np.geomspace(0.6, 2.2, 27)
#: Mean cosine of the displacements across lines, 1 being exact, from which on there are some; points that are
#: anywhere within 0.3 cells of their own have 0.25. By chance it is one over the root of the number of pairs.
MIN_PERIODICITY, CHANCES = 0.15, 6.0
#: A line distance that is that nearly as periodic as the best is its double or the like.
SAME = 0.9


def line_periods(
    points: NDArray[np.float64],
    cells: CellGrid,
    kind: NDArray[np.int64],
    is_probe: NDArray[np.bool_],
    n_groups: int,
    spacing: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Return each group's direction of lines [rad] and their distance [m], NaN where nothing repeats.

    Where a pulse lies on its line is chance, its line's distance to the next is not: displacements between
    near points, laid across the lines, gather at multiples of that distance. It is looked for in all
    directions by the cosine transform of the displacements' histogram.

    `kind`, shape (n_points,), tells group and strip: points of one kind are compared; its value modulo
    `n_groups` is the group, −1 is none.
    """
    n_bins = 2 * round(REACH / BIN) + 1
    counts = np.zeros((n_groups, n_bins * n_bins), dtype=np.int64)
    asking = cells.holding(is_probe[cells.rows])
    runs = cells.first[cells.around(2 * cells.size, asking)]
    _displacements(points, cells, asking, runs, kind, is_probe, spacing, n_groups, counts)
    places = BIN * (np.indices((n_bins, n_bins)).reshape(2, -1) - n_bins // 2)
    direction = np.arange(N_DIRECTIONS) * math.pi / N_DIRECTIONS
    across = np.cos(direction)[:, None] * places[1] - np.sin(direction)[:, None] * places[0]
    n_pairs = counts.sum(axis=1)
    found = np.full((2, n_groups), np.nan)
    known = np.flatnonzero(n_pairs > CHANCES**2)
    if not len(known):
        return found[0], found[1]
    waves = np.cos(2.0 * math.pi * across[:, None, :] / DISTANCES[:, None])
    share = counts[known] / n_pairs[known, None]
    power = np.einsum("gb,wb->gw", share, waves.reshape(-1, n_bins * n_bins))
    power = power.reshape(len(known), *waves.shape[:2])
    for g, of_group in zip(known, power, strict=True):
        best = of_group.max()
        if best < max(MIN_PERIODICITY, CHANCES / math.sqrt(n_pairs[g])):
            continue
        turn, _ = np.unravel_index(int(of_group.argmax()), of_group.shape)
        # Half the distance of lines repeats them, too.
        own = of_group[turn]
        peak = int(np.flatnonzero(own >= SAME * best)[-1])
        while peak > 0 and own[peak - 1] > own[peak]:
            peak -= 1
        found[:, g] = direction[turn], DISTANCES[peak] * spacing
    return found[0], found[1]


@kernel
def _displacements(points, cells, asking, runs, kind, is_probe, spacing, n_groups, counts):  # type: ignore[no-untyped-def]
    """Count displacements from probes to near points of their kind, by group and square."""
    half = round(REACH / BIN)
    n_bins = 2 * half + 1
    for one in range(len(asking)):
        for k in range(cells.first[asking[one]], cells.first[asking[one] + 1]):
            i = cells.rows[k]
            if not is_probe[i]:
                continue
            for row in range(runs.shape[1]):
                for m in range(runs[one, row, 0], runs[one, row, 1]):
                    j = cells.rows[m]
                    if j == i or kind[j] != kind[i]:
                        continue
                    x = int(np.rint((points[j, 0] - points[i, 0]) / (BIN * spacing))) + half
                    y = int(np.rint((points[j, 1] - points[i, 1]) / (BIN * spacing))) + half
                    if 0 <= x < n_bins and 0 <= y < n_bins:
                        counts[kind[i] % n_groups, x * n_bins + y] += 1
