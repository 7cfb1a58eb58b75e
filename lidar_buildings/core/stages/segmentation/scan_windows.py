"""The moving window laid along the scan lines, each group of roofs with the pattern of its own points."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.cell_grid import CellGrid
from lidar_buildings.core.neighbours.scan_neighbours import Pulses
from lidar_buildings.core.neighbours.scan_pattern import (
    MAX_RATIO,
    MIN_RATIO,
    ScanPattern,
    measure_scan_patterns,
)
from lidar_buildings.core.stages.segmentation.windows import chain_windows, turned

#: A group's points are chained by at least that much: more than gaps between lines usually are [spacings].
MIN_GROUP_REACH = 4.5
#: So much more than half the window is still in it: rounding does not tear lattices.
SLACK = 1.0 + 1e-6


class Chains(NamedTuple):
    """Points chained by the moving window."""

    component: NDArray[np.int64]  #: from 0, shape (n_points,)
    n_components: int  #: number of components
    patterns: list[ScanPattern]  #: the pattern whose window chained each component
    #: What was gathered before, of which each component is a part, from 0, shape (n_points,).
    group: NDArray[np.int64]
    group_patterns: list[ScanPattern]  #: measured of each group


def chain_along_scan(
    pulses: Pulses,
    window: float,
    spacing: float,
    scan_angle: NDArray[np.float64] | None = None,
    cells: CellGrid | None = None,
    min_ratio: float = MIN_RATIO,
) -> Chains:
    """
    Number the connected components of points that lie in each other's windows.

    Points are first gathered in groups by a generous square window. A group's pattern is measured from its
    own points, so that it does not matter what else there is in the tile, and where it has lines its points
    are chained by a rectangle along them; otherwise by a square.

    Parameters
    ----------
    pulses : Pulses
        In any order.
    window : float
        Sides of the window in units of the spacings along and across the lines.
    spacing : float
        1/√density [m].
    scan_angle : ndarray of shape (n_points,), optional
        See `lidar_buildings.core.neighbours.scan_pattern.measure_scan_patterns` [deg].
    cells : CellGrid, optional
        The points by `lidar_buildings.core.neighbours.scan_pattern.scan_cells`, if they are at hand.
    min_ratio : float
        Ratio of the spacings along and across from which there are lines.
    """
    half = window / 2.0 * SLACK
    component, n_components = chain_windows(pulses.points, (half * spacing, half * spacing))
    group, patterns = _groups(pulses, half, spacing, scan_angle, cells, min_ratio)
    has_lines = np.array([not one.is_isotropic for one in patterns], dtype=bool)
    chain_patterns = [ScanPattern.isotropic(spacing)] * n_components
    if not has_lines.any():
        return Chains(component, n_components, chain_patterns, group, patterns)
    order = np.argsort(group, kind="stable")
    first = np.searchsorted(group[order], np.arange(len(patterns) + 1))
    for number in np.flatnonzero(has_lines):
        rows = order[first[number] : first[number + 1]]
        part, n_parts = chain_windows(
            turned(pulses.points.take(rows, axis=0), patterns[number]), (half, half)
        )
        component[rows] = n_components + part
        n_components += n_parts
        chain_patterns += [patterns[number]] * n_parts
    used, component = np.unique(component, return_inverse=True)
    return Chains(component, len(used), [chain_patterns[k] for k in used], group, patterns)


def _groups(
    pulses: Pulses,
    half: float,
    spacing: float,
    scan_angle: NDArray[np.float64] | None,
    cells: CellGrid | None,
    min_ratio: float,
) -> tuple[NDArray[np.int64], list[ScanPattern]]:
    """
    Return each point's group and the groups' patterns; no window of a group reaches another of its kind.
    """
    reach = max(2.0 * half, MIN_GROUP_REACH) * spacing
    group, n_groups = chain_windows(pulses.points, (reach, reach))
    patterns = measure_scan_patterns(
        pulses, group, n_groups, spacing, scan_angle=scan_angle, cells=cells, min_ratio=min_ratio
    )
    is_wide = np.array([half * math.hypot(one.along, one.across) > reach for one in patterns], dtype=bool)
    rows = np.flatnonzero(is_wide[group]) if is_wide.any() else np.zeros(0, dtype=np.intp)
    if not len(rows):
        return group, patterns
    # Lines so far apart that the window reaches beyond the group: gather them once more by what it may reach.
    wider = half * spacing * math.sqrt(MAX_RATIO)
    some = pulses.select(rows)
    group_of_some, n_more = chain_windows(some.points, (wider, wider))
    angle = None if scan_angle is None else scan_angle[rows]
    patterns += measure_scan_patterns(
        some, group_of_some, n_more, spacing, scan_angle=angle, min_ratio=min_ratio
    )
    group[rows] = n_groups + group_of_some
    return group, patterns
