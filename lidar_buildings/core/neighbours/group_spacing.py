"""
The point spacing of each of several groups of points, from a sample of each: quick where there are many.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.cell_grid import CellGrid
from lidar_buildings.core.neighbours.nearest_neighbours import find_nth
from lidar_buildings.core.neighbours.point_spacing import FEW_PROBES, NEIGHBOURS, middle_of
from lidar_buildings.core.neighbours.scan_neighbours import mark_probes

#: Fewest points that each neighbour that a density is estimated from needs in its group.
POINTS_A_NEIGHBOUR = 10


def group_spacings(
    points: NDArray[np.float64], cells: CellGrid, group: NDArray[np.int64], n_groups: int
) -> NDArray[np.float64]:
    """
    Measure 1/√density of each group of points from its own points alone; group −1 is none.

    As `core.neighbours.point_spacing.measure_spacing`, the median by area of k/(π d²), d the distance to the
    k-th neighbour in plan; but from a sample, and with neighbours sought nearby only, in cells a few spacings
    wide. NaN for a group of fewer than 20 points, or most of whose neighbours are not near.
    """
    size = np.bincount(group[group >= 0], minlength=n_groups)
    is_probe = mark_probes(points, group, size, FEW_PROBES, 2 * POINTS_A_NEIGHBOUR)
    probes = np.flatnonzero(is_probe)
    nth = np.minimum(NEIGHBOURS, size // POINTS_A_NEIGHBOUR)
    distance = np.full(len(group), np.inf)
    find_nth(cells, group, nth, is_probe, distance, 0, len(cells.numbers))
    order = probes[np.argsort(group[probes], kind="stable")]
    first = np.searchsorted(group[order], np.arange(n_groups + 1))
    spacings = np.full(n_groups, np.nan)
    for number in np.flatnonzero(np.diff(first)):
        middle, _ = middle_of(distance[order[first[number] : first[number + 1]]])
        if 0.0 < middle < math.inf:
            spacings[number] = middle * math.sqrt(math.pi / (nth[number] + 1 / 3))
    return spacings
