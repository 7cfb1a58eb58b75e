"""What is asked of components of points: their members, anchors, area."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.ids import building_id
from lidar_buildings.core.neighbours.cell_grid import cell_numbers
from lidar_buildings.core.neighbours.few_rows import rows_by_group

#: Share of cells of the spacing's size that random points fill: 1 − 1/e.
FILLED_SHARE = 0.632
#: Ids are drawn from 1 to this number.
LARGEST_ID = 2**32 - 1
#: Up to so many cells a point have an entry each in a table; numbers are ranked where there are more.
MAX_TABLE_CELLS = 64


def sizes(component: NDArray[np.int64], n_components: int) -> NDArray[np.int64]:
    """Return the number of points of every component."""
    return np.bincount(component, minlength=n_components).astype(np.int64)


def occupied_areas(
    points: NDArray[np.float64], component: NDArray[np.int64], n_components: int, spacing: float
) -> NDArray[np.float64]:
    """
    Return the area [m²] of every component: its occupied square metres, as far as points can tell.

    Points that fall into one cell of the spacing's size count once, so that overlapping strips do not add to
    the area; a cell that random points leave empty is made up for by the share of cells that they fill.
    """
    numbers = cell_numbers(points, spacing)
    n_cells = int(numbers.max(initial=-1)) + 1
    if n_cells > MAX_TABLE_CELLS * (len(points) + 1024):
        ranked, numbers = np.unique(numbers, return_inverse=True)
        n_cells = len(ranked)
    count = _cells_of_each(numbers, n_cells, *rows_by_group(component, n_components))
    return count * (spacing**2 / FILLED_SHARE)


@kernel
def anchor_rows(points, component, n_components):  # type: ignore[no-untyped-def]
    """
    Return the row of every component's anchor: its westernmost point, ties broken by y, then z; −1 if empty.

    Points of component −1 are of none.
    """
    anchor = np.full(n_components, -1, dtype=np.int64)
    for i in range(len(component)):
        k = component[i]
        if k < 0:
            continue
        if anchor[k] < 0 or _comes_first(points[i], points[anchor[k]]):
            anchor[k] = i
    return anchor


def distinct_ids(anchors: NDArray[np.float64]) -> NDArray[np.uint32]:
    """
    Return one id per anchor, all different.

    Where two anchors share a cell, and so an id, the western one keeps it and the other takes the next free.
    """
    wanted = [building_id(anchor) for anchor in anchors]
    order = np.lexsort((anchors[:, 2], anchors[:, 1], anchors[:, 0]))
    ids = np.zeros(len(anchors), dtype=np.uint32)
    taken = set(wanted)
    given: set[int] = set()
    for row in order:
        number = wanted[row]
        if number in given:
            while number in taken:
                number = number % LARGEST_ID + 1
            taken.add(number)
        given.add(number)
        ids[row] = number
    return ids


@inner_kernel
def _comes_first(p, q):  # type: ignore[no-untyped-def]
    """Whether a point comes before another by x, then y, then z."""
    for axis in range(3):
        if p[axis] != q[axis]:
            return p[axis] < q[axis]
    return False


@kernel
def _cells_of_each(numbers, n_cells, rows, first):  # type: ignore[no-untyped-def]
    """Count the different cells of every component."""
    last = np.full(n_cells, -1, dtype=np.int32)
    count = np.zeros(len(first) - 1, dtype=np.int64)
    for k in range(len(count)):
        for m in range(first[k], first[k + 1]):
            number = numbers[rows[m]]
            if last[number] != k:
                last[number] = k
                count[k] += 1
    return count
