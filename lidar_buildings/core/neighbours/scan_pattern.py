"""The pattern that a scanner leaves on a surface: direction of its lines, spacing along and across them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.point_array import checked_column
from lidar_buildings.core.neighbours.cell_grid import CellGrid, rows_by_cell
from lidar_buildings.core.neighbours.line_periods import line_periods
from lidar_buildings.core.neighbours.point_spacing import mark_probes

#: Points whose neighbours are looked at in a group; a mean direction of so many is known to a few degrees.
MAX_PROBES = 160
#: Fewer tell nothing.
MIN_PROBES = 20
#: Length of the mean of doubled directions (1: all parallel, 0: none preferred) from which there are lines.
MIN_CONCENTRATION = 0.45
#: Spacings along and across that differ by less than this factor are one.
MIN_RATIO = 1.5
#: Beyond it the pairs of a double pulse, or the like, were taken for lines.
MAX_RATIO = 40.0
#: Side of the cells in which neighbours are sought [spacings].
CELL = 1.5
#: What 1 is in whole numbers.
UNIT = 2**30
#: Points nearer than this are of one pulse, or of one that was recorded twice [spacings].
SAME_PULSE = 0.05
#: Neighbours farther than the second by more than this factor, squared, do not count: they would by 1/64.
LAST = 4.0
#: Neighbours so little farther than the second nearest are as near.
TIE = 1.0 + 1e-6
#: Neighbours on the line lie within this angle of its direction: cosine of 30°.
ON_LINE = 0.866
#: Cells on each side in which the lines beside are sought,
REACH = 4
#: which are at least this share of what density and step say away from a pulse.
OFF_LINE = 0.4


#: Pulses so far beside a line are on it: half way to the next one [spacings across].
BESIDE = 0.5
#: Share of the gaps between pulses on a line that is no longer than this, in steps: a window reaches as far.
_MOST_GAPS, _GAP_IN_STEPS = 0.9, 2.0


class Pulses(NamedTuple):
    """Points and what tells which of them follow each other."""

    points: NDArray[np.float64]  #: in any order [m], shape (n_points, 3)
    time: NDArray[np.float64]  #: empty if not known, shape (n_points,)
    strip: NDArray[np.int64]  #: empty if not known, shape (n_points,)

    def select(self, rows: NDArray[np.intp]) -> Pulses:
        """Return some of the points."""
        time = self.time[rows] if len(self.time) else self.time
        return Pulses(
            self.points.take(rows, axis=0), time, self.strip[rows] if len(self.strip) else self.strip
        )


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
    `cells` are the points by `scan_cells`, if they are at hand. Spacings that differ by less than the factor
    `min_ratio` are one. The direction is 0 and the spacings are the given one where no direction stands out.
    Below `MIN_RATIO` the nearest points need not be on a pulse's line: where nothing else tells lines, they
    are looked for as what repeats across, see `line_periods`.
    """
    patterns = [ScanPattern.isotropic(spacing) for _ in range(n_groups)]
    size = np.bincount(group[group >= 0], minlength=n_groups)
    if not (size >= MIN_PROBES).any():
        return patterns
    is_probe = mark_probes(pulses.points, group, size, MAX_PROBES, MIN_PROBES)
    cells = scan_cells(pulses, spacing) if cells is None else cells
    open_ = np.ones(n_groups, dtype=bool)
    for by_time in (True, False) if len(pulses.time) else (False,):
        has_lines, axis = _lines(pulses, cells, group, is_probe & open_[group], spacing, by_time)
        if has_lines.any():
            probes = is_probe & has_lines[group]
            for number, pattern in _spaced(pulses, cells, group, probes, spacing, by_time, axis, min_ratio):
                patterns[number] = pattern
                open_[number] = False
    if min_ratio < MIN_RATIO and (open_ & (size >= MIN_PROBES)).any():
        kind = np.where(open_[group] & (group >= 0), group, -1)
        if len(pulses.strip):
            strip = np.unique(pulses.strip, return_inverse=True)[1]
            kind = np.where(kind >= 0, kind + n_groups * strip, -1)
        probes = is_probe & (kind >= 0)
        direction, across = line_periods(pulses.points, cells, kind, probes, n_groups, spacing)
        for number in np.flatnonzero(~np.isnan(across)).tolist():
            along = spacing * spacing / across[number]
            if max(along, across[number]) >= min_ratio * min(along, across[number]):
                patterns[number] = ScanPattern(float(direction[number]), along, float(across[number]))
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
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Return which groups have lines, and the direction that their neighbours prefer [rad]."""
    n_groups = int(group.max(initial=-1)) + 1
    sums, asking = np.zeros((n_groups, 3), dtype=np.int64), cells.holding(is_probe[cells.rows])
    runs = cells.first[cells.around(cells.size, asking)]
    no_axis, step = np.zeros((0, 2)), np.zeros(0)
    _follow(pulses, cells, asking, runs, group, is_probe, spacing, by_time, sums, no_axis, step)
    cosine, sine, n_probes = sums[:, 0] / UNIT, sums[:, 1] / UNIT, sums[:, 2]
    concentration = np.hypot(cosine, sine) / np.maximum(n_probes, 1)
    direction = (np.arctan2(sine, cosine) / 2.0) % math.pi
    return (n_probes >= MIN_PROBES) & (concentration >= MIN_CONCENTRATION), direction


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
    step, sides = np.full(len(group), np.nan), np.full((len(group), 2), np.nan)
    asking, sums = cells.holding(is_probe[cells.rows]), np.zeros((0, 3), dtype=np.int64)
    runs = cells.first[cells.around(cells.size, asking)]
    _follow(pulses, cells, asking, runs, group, is_probe, spacing, by_time, sums, axis, step)
    along = _medians(step, group, len(axis))
    runs = cells.first[cells.around(REACH * cells.size, asking)]
    _lines_beside(pulses, cells, asking, runs, group, is_probe, spacing, axis, along, sides)
    both = _medians(sides.sum(axis=1) / 2.0, group, len(axis))
    # At the rim of a roof there are lines on one side only; so many lines apart are all rim.
    either = _medians(np.fmax(sides[:, 0], sides[:, 1]), group, len(axis))
    across = np.where(np.isnan(both), either, both)
    _next_on_line(pulses, cells, asking, runs, group, is_probe, axis, across, sides)
    gap = _medians(np.fmax(sides[:, 0], sides[:, 1]), group, len(axis), _MOST_GAPS)
    along = np.fmax(along, gap / _GAP_IN_STEPS)  # of pulses in clumps most neighbours are too near
    ratio = np.maximum(along, across) / np.minimum(along, across)
    found = np.flatnonzero((ratio >= min_ratio) & (ratio <= MAX_RATIO))
    return [(int(k), ScanPattern(float(direction[k]), float(along[k]), float(across[k]))) for k in found]


def _medians(
    values: NDArray[Any], group: NDArray[np.int64], n_groups: int, share: float = 0.5
) -> NDArray[np.float64]:
    """Return every group's median, or another quantile, of the numbers among the values; NaN of too few."""
    rows = np.flatnonzero(~np.isnan(values))
    order = rows[np.lexsort((values[rows], group[rows]))]
    count = np.bincount(group[order], minlength=n_groups)
    first = np.cumsum(count) - count
    medians = np.full(n_groups, np.nan)
    known = np.flatnonzero(count >= MIN_PROBES // 2)
    medians[known] = values[order[first[known] + (share * count[known]).astype(np.int64)]]
    return medians


@kernel
def _follow(pulses, cells, asking, runs, group, is_probe, spacing, by_time, sums, axis, step):  # type: ignore[no-untyped-def]
    """Add up (cos 2φ, sin 2φ, number of probes) of the directions φ to nearest neighbours, group by group."""
    # Farther ones count less. With `axis` known, write instead each probe's mean step along its line.
    near = np.empty((64, 3))
    for one in range(len(asking)):
        n = (runs[one, :, 1] - runs[one, :, 0]).sum()
        if n > len(near):
            near = np.empty((n, 3))
        for k in range(cells.first[asking[one]], cells.first[asking[one] + 1]):
            i = cells.rows[k]
            if not is_probe[i]:
                continue
            count, second = _gather(pulses, cells, runs[one], group, i, spacing, by_time, near)
            if second == np.inf:
                continue
            if len(axis) > 0:
                step[i] = spacing * _mean_step(near[:count], second, axis[group[i]], spacing)
            else:
                cosine, sine = _mean_direction(near[:count], second)
                sums[group[i], 0] += np.int64(UNIT * cosine)
                sums[group[i], 1] += np.int64(UNIT * sine)
                sums[group[i], 2] += 1


@kernel
def _lines_beside(pulses, cells, asking, runs, group, is_probe, spacing, axis, along, sides):  # type: ignore[no-untyped-def]
    """Write each probe's distance to the next line on its left and on its right."""
    near = np.empty(2)
    for one in range(len(asking)):
        for k in range(cells.first[asking[one]], cells.first[asking[one] + 1]):
            i = cells.rows[k]
            if not is_probe[i] or not along[group[i]] > 0.0:
                continue
            cos, sin = axis[group[i]]
            step = along[group[i]]
            least = OFF_LINE * spacing * spacing / step
            near[0], near[1] = np.inf, np.inf
            for row in range(runs.shape[1]):
                for m in range(runs[one, row, 0], runs[one, row, 1]):
                    j = cells.rows[m]
                    dx = pulses.points[j, 0] - pulses.points[i, 0]
                    dy = pulses.points[j, 1] - pulses.points[i, 1]
                    if abs(dx * cos + dy * sin) > step or not _are_mates(pulses, group, i, j):
                        continue
                    beside = dy * cos - dx * sin
                    side = 0 if beside > 0.0 else 1
                    if least <= abs(beside) < near[side]:
                        near[side] = abs(beside)
            for side in range(2):
                if near[side] < np.inf:
                    sides[i, side] = near[side]


@kernel
def _next_on_line(pulses, cells, asking, runs, group, is_probe, axis, across, sides):  # type: ignore[no-untyped-def]
    """Write each probe's distance to the next pulse on its line, backwards and forwards."""
    for one in range(len(asking)):
        for k in range(cells.first[asking[one]], cells.first[asking[one] + 1]):
            i = cells.rows[k]
            sides[i, 0], sides[i, 1] = np.nan, np.nan
            if not is_probe[i] or not across[group[i]] > 0.0:
                continue
            cos, sin = axis[group[i]]
            for row in range(runs.shape[1]):
                for m in range(runs[one, row, 0], runs[one, row, 1]):
                    j = cells.rows[m]
                    dx = pulses.points[j, 0] - pulses.points[i, 0]
                    dy = pulses.points[j, 1] - pulses.points[i, 1]
                    ahead = dx * cos + dy * sin
                    is_on_line = abs(dy * cos - dx * sin) <= BESIDE * across[group[i]]
                    if ahead == 0.0 or not is_on_line or not _are_mates(pulses, group, i, j):
                        continue
                    side = 0 if ahead < 0.0 else 1
                    if not sides[i, side] <= abs(ahead):
                        sides[i, side] = abs(ahead)


@inner_kernel
def _are_mates(pulses, group, i, j):  # type: ignore[no-untyped-def]
    """Whether two points are of one group and strip."""
    return group[i] == group[j] and (len(pulses.strip) == 0 or pulses.strip[i] == pulses.strip[j])


@kernel
def _gather(pulses, cells, runs, group, i, spacing, by_time, near):  # type: ignore[no-untyped-def]
    """Write neighbours (dx, dy, squared distance) to `near`; return how many, and the second distance."""
    count, nearest, second = 0, np.inf, np.inf
    same = (SAME_PULSE * spacing) ** 2
    points = pulses.points
    x, y = points[i, 0], points[i, 1]
    for row in range(len(runs)):
        for m in range(runs[row, 0], runs[row, 1]):
            j = cells.rows[m]
            dx, dy = points[j, 0] - x, points[j, 1] - y
            far = dx * dx + dy * dy
            if far <= same:
                continue
            if by_time:
                far = (pulses.time[j] - pulses.time[i]) ** 2
            if far > LAST * second or far == 0.0 or not _are_mates(pulses, group, i, j):
                continue
            if far < nearest:
                nearest, second = far, nearest
            elif far < second:
                second = far
            near[count, 0], near[count, 1], near[count, 2] = dx, dy, far
            count += 1
    return count, second


@kernel
def _mean_direction(near, second):  # type: ignore[no-untyped-def]
    """Return the weighted mean of (cos 2φ, sin 2φ) over neighbours."""
    cosine, sine, total = 0, 0, 0
    for k in range(len(near)):
        if near[k, 2] > LAST * second:
            continue
        dx, dy = near[k, 0], near[k, 1]
        ratio = min(1.0, second / near[k, 2])
        weight = UNIT * ratio * ratio * ratio
        square = dx * dx + dy * dy
        cosine += np.int64(weight * (dx * dx - dy * dy) / square)
        sine += np.int64(weight * 2.0 * dx * dy / square)
        total += np.int64(weight)
    return cosine / total, sine / total


@kernel
def _mean_step(near, second, axis, spacing):  # type: ignore[no-untyped-def]
    """Return the mean distance along an axis of the nearest neighbours on it [spacings], NaN if none."""
    total, count = 0, 0
    for k in range(len(near)):
        dx, dy = near[k, 0], near[k, 1]
        along = abs(dx * axis[0] + dy * axis[1])
        if near[k, 2] <= second * TIE and along >= ON_LINE * math.hypot(dx, dy):
            total += np.int64(UNIT * along / spacing)
            count += 1
    return total / UNIT / count if count > 0 else np.nan
