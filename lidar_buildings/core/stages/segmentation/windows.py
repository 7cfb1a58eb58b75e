"""Chains of points that lie in each other's windows, found cell by cell in linear time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import rows_by_cell, without_gaps
from lidar_buildings.core.neighbours.scan_pattern import ScanPattern
from lidar_buildings.core.neighbours.union_find import flatten, link, root


def chain_windows(xy: NDArray[np.float64], reach: tuple[float, float]) -> tuple[NDArray[np.int64], int]:
    """
    Number the connected components of points that lie in each other's windows; return also how many.

    Two points are linked if they differ by no more than `reach`, half the window's sides [m], in x and in y.
    Points are put into cells as large as the reach: a cell's points are all linked, and two neighbouring
    cells are joined by comparing their extreme points, so that no pairs have to be listed however dense the
    cloud is. Numbers, from 0, are the same whatever the points' order.
    """
    if reach[0] != reach[1]:
        xy = xy[:, :2] * np.array([1.0, reach[0] / reach[1]])
    cells = rows_by_cell(xy, reach[0])
    if cells.size > reach[0]:
        xy = _without_gaps(xy, reach[0])
        cells = rows_by_cell(xy, reach[0])
    return _chain(xy, cells.rows, cells.numbers, cells.first, cells.n_columns, reach[0])


def turned(xy: NDArray[np.float64], pattern: ScanPattern) -> NDArray[np.float64]:
    """Return positions along and across the scan lines in units of the spacing along and across."""
    cos, sin = np.cos(pattern.direction), np.sin(pattern.direction)
    along, across = xy[:, 0] * cos + xy[:, 1] * sin, xy[:, 1] * cos - xy[:, 0] * sin
    return np.column_stack((along / pattern.along, across / pattern.across))


def _without_gaps(xy: NDArray[np.float64], cell: float) -> NDArray[np.float64]:
    """
    Return positions with all gaps of several cells shortened, so that an enormous extent can be numbered.
    """
    return np.column_stack(
        [one - np.floor(one / cell) * cell + without_gaps(one, cell)[0] * cell for one in xy[:, :2].T]
    )


@kernel
def _chain(xy, rows, numbers, first, n_columns, reach):  # type: ignore[no-untyped-def]
    """Return every row's component and their number; components are numbered by their first cells."""
    n = len(numbers)
    parent = np.arange(n)
    box = _boxes(xy, rows, first)
    _link_beside(parent, numbers, n_columns, box, reach)
    _link_cornerwise(parent, xy, rows, numbers, first, n_columns, box, reach)
    flatten(parent)
    count = 0
    number = np.empty(n, dtype=np.int64)
    component = np.empty(len(rows), dtype=np.int64)
    for cell in range(n):
        if parent[cell] == cell:
            number[cell] = count
            count += 1
        for k in range(first[cell], first[cell + 1]):
            component[rows[k]] = number[parent[cell]]
    return component, count


@kernel
def _boxes(xy, rows, first):  # type: ignore[no-untyped-def]
    """Return the least x and y and the greatest x and y of every cell."""
    box = np.empty((len(first) - 1, 4))
    for cell in range(len(box)):
        box[cell, 0], box[cell, 1], box[cell, 2], box[cell, 3] = np.inf, np.inf, -np.inf, -np.inf
        for k in range(first[cell], first[cell + 1]):
            x, y = xy[rows[k], 0], xy[rows[k], 1]
            box[cell, 0], box[cell, 1] = min(box[cell, 0], x), min(box[cell, 1], y)
            box[cell, 2], box[cell, 3] = max(box[cell, 2], x), max(box[cell, 3], y)
    return box


@kernel
def _link_beside(parent, numbers, n_columns, box, reach):  # type: ignore[no-untyped-def]
    """Link cells to their eastern and northern neighbours, where one coordinate alone decides."""
    above = 0
    for cell in range(len(numbers)):
        number = numbers[cell]
        is_next = cell + 1 < len(numbers) and numbers[cell + 1] == number + 1
        if is_next and (number + 1) % n_columns != 0 and box[cell + 1, 0] - box[cell, 2] <= reach:
            link(parent, cell, cell + 1)
        while above < len(numbers) and numbers[above] < number + n_columns:
            above += 1
        is_above = above < len(numbers) and numbers[above] == number + n_columns
        if is_above and box[above, 1] - box[cell, 3] <= reach:
            link(parent, cell, above)


@kernel
def _link_cornerwise(parent, xy, rows, numbers, first, n_columns, box, reach):  # type: ignore[no-untyped-def]
    """Link cells to those that they touch at a corner, where they are not linked already."""
    above = 0
    for cell in range(len(numbers)):
        column = numbers[cell] % n_columns
        while above < len(numbers) and numbers[above] < numbers[cell] + n_columns - 1:
            above += 1
        for other in range(above, min(above + 3, len(numbers))):
            step = numbers[other] - numbers[cell] - n_columns
            if abs(step) != 1 or not 0 <= column + step < n_columns:
                continue
            if root(parent, cell) == root(parent, other) or box[other, 1] - box[cell, 3] > reach:
                continue
            gap = box[other, 0] - box[cell, 2] if step > 0 else box[cell, 0] - box[other, 2]
            if gap <= reach and _reach_each_other(xy, rows, first, cell, other, step, box, reach):
                link(parent, cell, other)


@kernel
def _reach_each_other(xy, rows, first, cell, other, side, box, reach):  # type: ignore[no-untyped-def]
    """
    Whether points of a cell and of another, to its north-east (side 1) or north-west (−1), are linked.

    Only what is within reach of the other cell's box is compared with its points.
    """
    nearest = box[other, 0] if side > 0 else box[other, 2]
    for i in range(first[cell], first[cell + 1]):
        x, y = xy[rows[i], 0], xy[rows[i], 1]
        if box[other, 1] - y > reach or side * (nearest - x) > reach:
            continue
        for j in range(first[other], first[other + 1]):
            if xy[rows[j], 1] - y <= reach and side * (xy[rows[j], 0] - x) <= reach:
                return True
    return False
