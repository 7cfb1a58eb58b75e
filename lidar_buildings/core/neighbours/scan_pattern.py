"""
The pattern that a scanner leaves on a surface: the direction of its lines, the spacing along and across them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.model.point_array import checked_column
from lidar_buildings.core.neighbours.cell_grid import CellGrid, rows_by_cell
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.neighbours.scan_neighbours import (
    CELLS_A_BLOCK,
    UNIT,
    Pulses,
    add_directions,
    lines_beside,
    mark_probes,
    steps_along,
)

#: Points whose neighbours are looked at in a group; a mean direction of so many is known to a few degrees.
MAX_PROBES = 160
#: Fewer tell nothing.
MIN_PROBES = 20
#: Length of the mean of doubled directions (1: all parallel, 0: none preferred) from which there are lines,
MIN_CONCENTRATION = 0.6
#: and where the scan angle rises along them or across them, too.
MIN_BACKED_CONCENTRATION = 0.35
#: Largest difference of the two directions [deg], and the share of the angle's variance that is its slope.
MAX_ANGLE_OFF_DEG, MIN_ANGLE_FIT = 15.0, 0.3
#: Spacings along and across that differ by less than this factor are one.
MIN_RATIO = 1.5
#: Beyond it the pairs of a double pulse, or the like, were taken for lines.
MAX_RATIO = 40.0
#: Side of the cells in which neighbours are sought [spacings].
CELL = 1.5


@dataclass(frozen=True)
class ScanPattern:
    """How pulses lie on a surface, seen from above."""

    direction: float  #: of the scan lines, counter-clockwise from x, 0 to π (exclusive) [rad]
    #: Distance of neighbouring pulses of a line, and of neighbouring lines [m], > 0.
    along: float
    across: float

    @property
    def is_isotropic(self) -> bool:
        """Whether no direction is preferred."""
        return self.along == self.across

    @property
    def spacing(self) -> float:
        """Side of the square that belongs to a pulse [m]."""
        return math.sqrt(self.along * self.across)

    @classmethod
    def isotropic(cls, spacing: float) -> ScanPattern:
        """Return the pattern without lines."""
        return cls(0.0, spacing, spacing)


def as_pulses(
    cloud: NDArray[np.float64], gps_time: ArrayLike | None, point_source_id: ArrayLike | None
) -> Pulses:
    """
    Return points with the columns that tell their neighbours on a line.

    ValueError if a column has the wrong shape or is no number.
    """
    n = len(cloud)
    time, strip = np.zeros(0), np.zeros(0, dtype=np.int64)
    if gps_time is not None:
        time = checked_column("gps_time", gps_time, n, np.float64)
    if point_source_id is not None:
        strip = checked_column("point_source_id", point_source_id, n, np.int64)
    is_told = len(time) > 0 and bool(np.isfinite(time).all()) and time.min() < time.max()
    return Pulses(cloud, time if is_told else np.zeros(0), strip)


def measure_scan_patterns(
    pulses: Pulses,
    group: NDArray[np.int64],
    n_groups: int,
    spacing: float,
    *,
    scan_angle: NDArray[np.float64] | None = None,
    cells: CellGrid | None = None,
    min_ratio: float = MIN_RATIO,
) -> list[ScanPattern]:
    """
    Measure the direction of scan lines and the spacings along and across them, of each group of points.

    A pulse's neighbours on its line are those next to it in time, or else the nearest of its strip in plan;
    where most of these lie in one direction, that is the lines', and the nearest points on both sides tell
    how far apart lines are. Strips are not mixed: in an overlap the spacing is that of one strip. Groups have
    no say in each other's pattern.

    `group` is 0 to `n_groups` (exclusive), or −1 for points of none; `spacing` is 1/√density [m];
    `scan_angle` [deg] backs weak signs of lines along or across which it rises; `cells` are the points by
    `scan_cells`, if they are at hand. Spacings that differ by less than the factor `min_ratio` are one. The
    direction is 0 and the spacings are the given one where no direction stands out.
    """
    patterns = [ScanPattern.isotropic(spacing) for _ in range(n_groups)]
    size = np.bincount(group[group >= 0], minlength=n_groups)
    if not (size >= MIN_PROBES).any():
        return patterns
    is_probe = mark_probes(pulses.points, group, size, MAX_PROBES, MIN_PROBES)
    cells = scan_cells(pulses, spacing) if cells is None else cells
    open_ = np.ones(n_groups, dtype=bool)
    for by_time in (True, False) if len(pulses.time) else (False,):
        has_lines, axis = _lines(pulses, cells, group, is_probe & open_[group], spacing, by_time, scan_angle)
        if has_lines.any():
            probes = is_probe & has_lines[group]
            for number, pattern in _spaced(pulses, cells, group, probes, spacing, by_time, axis, min_ratio):
                patterns[number] = pattern
                open_[number] = False
    return patterns


def scan_cells(pulses: Pulses, spacing: float) -> CellGrid:
    """Return the cells in which neighbours are sought."""
    return rows_by_cell(pulses.points, CELL * spacing)


def _lines(
    pulses: Pulses,
    cells: CellGrid,
    group: NDArray[np.int64],
    is_probe: NDArray[np.bool_],
    spacing: float,
    by_time: bool,
    scan_angle: NDArray[np.float64] | None,
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Return which groups have lines, and the direction that their neighbours prefer [rad]."""
    n_groups = int(group.max(initial=-1)) + 1
    sums = np.zeros((n_groups, 3), dtype=np.int64)
    add_directions(pulses, cells, group, is_probe, spacing, by_time, sums)
    cosine, sine, n_probes = sums[:, 0] / UNIT, sums[:, 1] / UNIT, sums[:, 2]
    concentration = np.hypot(cosine, sine) / np.maximum(n_probes, 1)
    direction = (np.arctan2(sine, cosine) / 2.0) % math.pi
    enough = n_probes >= MIN_PROBES
    has_lines = enough & (concentration >= MIN_CONCENTRATION)
    if scan_angle is not None:
        for number in np.flatnonzero(enough & ~has_lines & (concentration >= MIN_BACKED_CONCENTRATION)):
            probes = is_probe & (group == number)
            has_lines[number] = _is_backed(pulses, probes, scan_angle, direction[number])
    return has_lines, direction


def _is_backed(
    pulses: Pulses, rows: NDArray[np.bool_], scan_angle: NDArray[np.float64], direction: float
) -> bool:
    """Whether the scan angle of the probes' largest strip rises along or across a direction."""
    if len(pulses.strip):
        numbers, count = np.unique(pulses.strip[rows], return_counts=True)
        rows = rows & (pulses.strip == numbers[np.argmax(count)])
    xy, angle = pulses.points[rows, :2], scan_angle[rows]
    order = np.lexsort((angle, xy[:, 1], xy[:, 0]))
    xy, angle = xy[order] - xy[order].mean(axis=0), angle[order] - angle[order].mean()
    if not np.isfinite(angle).all() or not angle.any():
        return False
    slope = np.linalg.lstsq(xy, angle, rcond=None)[0]
    if 1.0 - np.sum((angle - xy @ slope) ** 2) / np.sum(angle**2) < MIN_ANGLE_FIT:
        return False
    off = (math.atan2(slope[1], slope[0]) - direction + math.pi / 4) % (math.pi / 2) - math.pi / 4
    return abs(math.degrees(off)) <= MAX_ANGLE_OFF_DEG


def _spaced(
    pulses: Pulses,
    cells: CellGrid,
    group: NDArray[np.int64],
    is_probe: NDArray[np.bool_],
    spacing: float,
    by_time: bool,
    direction: NDArray[np.float64],
    min_ratio: float,
) -> list[tuple[int, ScanPattern]]:
    """Return (group, pattern) of every group whose spacings along and across its lines clearly differ."""
    axis = np.column_stack((np.cos(direction), np.sin(direction)))
    step = np.full(len(group), np.nan)
    n_cells = len(cells.numbers)
    for_row_blocks(
        lambda a, b: steps_along(pulses, cells, group, is_probe, spacing, by_time, axis, step, a, b),
        n_cells,
        CELLS_A_BLOCK,
    )
    along = _medians(step, group, len(axis))
    sides = np.full((len(group), 2), np.nan)
    for_row_blocks(
        lambda a, b: lines_beside(pulses, cells, group, is_probe, spacing, axis, along, sides, a, b),
        n_cells,
        CELLS_A_BLOCK,
    )
    both = _medians(sides.sum(axis=1) / 2.0, group, len(axis))
    # At the rim of a roof there are lines on one side only; so many lines apart are all rim.
    either = _medians(np.fmax(sides[:, 0], sides[:, 1]), group, len(axis))
    across = np.where(np.isnan(both), either, both)
    ratio = np.maximum(along, across) / np.minimum(along, across)
    found = np.flatnonzero((ratio >= min_ratio) & (ratio <= MAX_RATIO))
    return [(int(k), ScanPattern(float(direction[k]), float(along[k]), float(across[k]))) for k in found]


def _medians(values: NDArray[Any], group: NDArray[np.int64], n_groups: int) -> NDArray[np.float64]:
    """Return every group's median of the values that are numbers, NaN where they are too few."""
    rows = np.flatnonzero(~np.isnan(values))
    order = rows[np.lexsort((values[rows], group[rows]))]
    count = np.bincount(group[order], minlength=n_groups)
    first = np.cumsum(count) - count
    medians = np.full(n_groups, np.nan)
    known = np.flatnonzero(count >= MIN_PROBES // 2)
    medians[known] = values[order[first[known] + count[known] // 2]]
    return medians
