"""The moving window: points that lie in each other's windows, chained cell by cell along the scan lines."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import CellGrid, rows_by_cell, without_gaps
from lidar_buildings.core.neighbours.point_spacing import MAX_SPARSER, MIN_SPARSER, group_spacings
from lidar_buildings.core.neighbours.scan_pattern import (
    MAX_RATIO,
    MIN_RATIO,
    Pulses,
    ScanPattern,
    measure_scan_patterns,
    scan_cells,
)
from lidar_buildings.core.neighbours.union_find import flatten, link, root
from lidar_buildings.core.surfaces.surface_patches import plan_areas

#: Share of cells of the spacing's size that random points fill: 1 − 1/e.
FILLED_SHARE = 0.632
#: A group's points are chained by at least that much: more than gaps between lines usually are [spacings].
MIN_GROUP_REACH = 4.5
#: So much more than half the window is still in it: rounding does not tear lattices.
SLACK = 1.0 + 1e-6


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
    if (cell := reach[0]) < cells.size:  # gaps are shortened, so that any extent can be numbered
        moved = [one - np.floor(one / cell) * cell + without_gaps(one, cell)[0] * cell for one in xy[:, :2].T]
        xy = np.column_stack(moved)
        cells = rows_by_cell(xy, cell)
    return _chain(xy, cells.rows, cells.numbers, cells.first, cells.n_columns, reach[0])


def turned(xy: NDArray[np.float64], pattern: ScanPattern) -> NDArray[np.float64]:
    """Return positions along and across the scan lines in units of the spacing along and across."""
    cos, sin = np.cos(pattern.direction), np.sin(pattern.direction)
    along, across = xy[:, 0] * cos + xy[:, 1] * sin, xy[:, 1] * cos - xy[:, 0] * sin
    return np.column_stack((along / pattern.along, across / pattern.across))


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
    """Whether points of a cell and of one to its north-east (1) or north-west (−1) are linked."""
    nearest = box[other, 0] if side > 0 else box[other, 2]
    for i in range(first[cell], first[cell + 1]):
        x, y = xy[rows[i], 0], xy[rows[i], 1]
        if box[other, 1] - y > reach or side * (nearest - x) > reach:
            continue
        for j in range(first[other], first[other + 1]):
            if xy[rows[j], 1] - y <= reach and side * (xy[rows[j], 0] - x) <= reach:
                return True
    return False


class Chains(NamedTuple):
    """Points chained by the moving window."""

    component: NDArray[np.int64]  #: from 0, shape (n_points,)
    n_components: int  #: number of components
    patterns: list[ScanPattern]  #: the pattern whose window chained each component


def chain_along_scan(
    pulses: Pulses, window: float, spacing: float, cells: CellGrid | None = None, min_ratio: float = MIN_RATIO
) -> Chains:
    """
    Number the connected components of points that lie in each other's windows.

    Points are first gathered in groups by a generous square window. A group's pattern is measured from its
    own points, so that it does not matter what else there is in the tile, and where it has lines its points
    are chained by a rectangle along them; otherwise by a square, of its own spacing if it is sparser than the
    rest. `window` are its sides in spacings along and across the lines, `spacing` is 1/√density [m]; `cells`
    are the pulses by `scan_pattern.scan_cells`; lines are where spacings differ by the factor `min_ratio`.
    """
    half = window / 2.0 * SLACK
    component, n_components = chain_windows(pulses.points, (half * spacing, half * spacing))
    group, patterns = _groups(pulses, half, spacing, cells, min_ratio)
    general = ScanPattern.isotropic(spacing)
    has_own = np.array([one != general for one in patterns], dtype=bool)
    chain_patterns = [general] * n_components
    if not has_own.any():
        return Chains(component, n_components, chain_patterns)
    order = np.argsort(group, kind="stable")
    first = np.searchsorted(group[order], np.arange(len(patterns) + 1))
    for number in np.flatnonzero(has_own):
        rows = order[first[number] : first[number + 1]]
        part, n_parts = chain_windows(
            turned(pulses.points.take(rows, axis=0), patterns[number]), (half, half)
        )
        component[rows] = n_components + part
        n_components += n_parts
        chain_patterns += [patterns[number]] * n_parts
    used, component = np.unique(component, return_inverse=True)
    return Chains(component, len(used), [chain_patterns[k] for k in used])


def _groups(
    pulses: Pulses, half: float, spacing: float, cells: CellGrid | None, min_ratio: float
) -> tuple[NDArray[np.int64], list[ScanPattern]]:
    """Return each point's group and the groups' patterns; no window reaches another of its kind."""
    reach = max(2.0 * half, MIN_GROUP_REACH) * spacing
    group, n_groups = chain_windows(pulses.points, (reach, reach))
    patterns = _patterns(pulses, group, n_groups, spacing, cells, min_ratio)
    is_wide = np.array([half * math.hypot(one.along, one.across) > reach for one in patterns], dtype=bool)
    rows = np.flatnonzero(is_wide[group]) if is_wide.any() else np.zeros(0, dtype=np.intp)
    if not len(rows):
        return group, patterns
    # Lines so far apart that the window reaches beyond the group: gather them once more by what it may reach.
    wider = half * spacing * math.sqrt(MAX_RATIO)
    some = pulses.select(rows)
    group_of_some, n_more = chain_windows(some.points, (wider, wider))
    patterns += _patterns(some, group_of_some, n_more, spacing, None, min_ratio)
    group[rows] = n_groups + group_of_some
    return group, patterns


def _patterns(
    pulses: Pulses,
    group: NDArray[np.int64],
    n_groups: int,
    spacing: float,
    cells: CellGrid | None,
    min_ratio: float,
) -> list[ScanPattern]:
    """Return the groups' patterns; one without lines has its own spacing if its points are sparser."""
    patterns = measure_scan_patterns(pulses, group, n_groups, spacing, cells=cells, min_ratio=min_ratio)
    wide_cells = scan_cells(pulses, MAX_SPARSER / 2.0 * spacing)
    own = group_spacings(pulses.points, wide_cells, group, n_groups)
    return [
        ScanPattern.isotropic(min(own_spacing, MAX_SPARSER * spacing))
        if one.is_isotropic and own_spacing > MIN_SPARSER * spacing
        else one
        for one, own_spacing in zip(patterns, own.tolist(), strict=True)
    ]


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
