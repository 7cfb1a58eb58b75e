"""What is asked of components of points: their members, anchors, area."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.ids import building_id
from lidar_buildings.core.neighbours.cell_grid import rows_by_cell
from lidar_buildings.core.surfaces.surface_patches import plan_areas

#: Share of cells of the spacing's size that random points fill: 1 − 1/e.
FILLED_SHARE = 0.632
#: Ids are drawn from 1 to this number.
LARGEST_ID = 2**32 - 1


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
    cells = rows_by_cell(points, spacing)
    return plan_areas(component[cells.rows], n_components, cells.first, spacing) / FILLED_SHARE


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


@kernel
def _comes_first(p, q):  # type: ignore[no-untyped-def]
    """Whether a point comes before another by x, then y, then z."""
    for axis in range(3):
        if p[axis] != q[axis]:
            return p[axis] < q[axis]
    return False
