"""Buildings connected by a neck of few points, cut apart."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import rows_by_cell
from lidar_buildings.core.stages.segmentation.windows import chain_windows, occupied_areas

#: Half the side of the square in which a point that joins two roofs all by itself has no other [spacings].
ALONE = 1.25


def cut_necks(
    positions: NDArray[np.float64],
    component: NDArray[np.int64],
    *,
    window: float,
    min_neck: float,
    min_points: int,
    min_area: float,
) -> list[tuple[int, NDArray[np.intp]]]:
    """
    Find the parts of components that only necks join.

    A point is in a neck if its window holds fewer points than a strip of the least width would, or if it
    stands alone amid a gap; the other points are chained without them, as in DBSCAN (Ester and others, 1996).
    Where at least two of the chains are as large as a building these are parts, and every other point goes to
    the part whose point is nearest.

    Positions are (n_points, 2), in any order; `component` counts from 0, and no point of one lies in the
    window of another's. Lengths and areas are in units of the spacing. Returned are component and rows of
    every part but the first of each component that falls apart.
    """
    half = window / 2.0
    # A strip of width w has w points a spacing.
    cells = rows_by_cell(positions, half)
    is_core = _core(cells, cells.first[cells.around(cells.size)], half, math.ceil(min_neck * window))
    if is_core.all() or not is_core.any():
        return []
    core = np.flatnonzero(is_core)
    own = positions.take(core, axis=0)
    part, n_parts = chain_windows(own, (half, half))
    component_of = np.zeros(n_parts, dtype=np.int64)
    component_of[part] = component[core]
    is_large = np.bincount(part, minlength=n_parts) >= min_points
    if np.bincount(component_of[is_large], minlength=1).max() > 1:
        is_large &= occupied_areas(own, part, n_parts, 1.0) >= min_area
    label, found = np.full(len(positions), -1, dtype=np.int64), []
    label[core] = np.where(is_large[part], part, -1)
    for number in np.flatnonzero(np.bincount(component_of[is_large], minlength=1) > 1):
        rows = np.flatnonzero(component == number)
        nearest = _nearest_labels(positions.take(rows, axis=0), label[rows])
        # Parts are numbered from the south-west, whatever the points' order.
        found += [(int(number), rows[nearest == one]) for one in np.flatnonzero(np.bincount(nearest))[1:]]
    return found


def _nearest_labels(positions: NDArray[np.float64], label: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return labels, those of −1 replaced by the label of the nearest point that has one."""
    members, others = np.flatnonzero(label >= 0), np.flatnonzero(label < 0)
    # By their coordinates, so that of equally near ones the same is taken in whatever order they come.
    members = members[np.lexsort(positions.take(members, axis=0).T)]
    known = positions.take(members, axis=0)
    nearest = cKDTree(known, balanced_tree=False, compact_nodes=False).query(positions[others])[1]
    labels = label.copy()
    labels[others] = label[members[nearest]]
    return labels


@kernel
def _core(cells, runs, half, needed):  # type: ignore[no-untyped-def]
    """Return which points have `needed` in their windows, their own among them, and do not stand alone."""
    is_core = np.zeros(len(cells.rows), dtype=np.bool_)
    for cell in range(len(cells.numbers)):
        for k in range(cells.first[cell], cells.first[cell + 1]):
            is_core[cells.rows[k]] = _is_core(cells, runs[cell], k, half, needed)
    return is_core


@kernel
def _is_core(cells, runs, i, half, needed):  # type: ignore[no-untyped-def]
    """Whether a point has enough others in its window, one of them near."""
    x, y = cells.points[i, 0], cells.points[i, 1]
    count, is_alone = 0, True
    for row in (1, 0, 2):
        for j in range(runs[row, 0], runs[row, 1]):
            far = max(abs(cells.points[j, 0] - x), abs(cells.points[j, 1] - y))
            if far > half:
                continue
            count += 1
            if 0.0 < far <= ALONE:
                is_alone = False
            if count >= needed and not is_alone:
                return True
    return False
