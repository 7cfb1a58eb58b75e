"""
Neighbours on a scan line and on the lines beside it, cell by cell; kernels of `scan_pattern`.

Sums are of whole numbers, so that they are the same in whatever order points come.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.windows import first_windows

#: What 1 is in whole numbers.
UNIT = 2**30
#: Cells a block of work.
CELLS_A_BLOCK = 2048
#: Points nearer than this are of one pulse, or of one that was recorded twice [spacings].
SAME_PULSE = 0.05
#: Neighbours farther than the second by more than this factor, squared, do not count: they would by 1/64.
LAST = 4.0
#: Neighbours there is room for; only in clouds with many points in one place are there more.
MAX_NEAR = 256
#: Neighbours so little farther than the second nearest are as near.
TIE = 1.0 + 1e-6
#: Neighbours on the line lie within this angle of its direction: cosine of 30°.
ON_LINE = 0.866
#: Cells on each side in which the lines beside are sought,
REACH = 4
#: which are at least this share of what density and step say away from a pulse.
OFF_LINE = 0.4
#: Multipliers of the hash that picks probes (xorshift64* of Vigna 2016; golden ratio).
_MIX, _GOLDEN = np.uint64(2685821657736338717), np.uint64(0x9E3779B97F4A7C15)


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


def mark_probes(
    points: NDArray[np.float64], group: NDArray[np.int64], size: NDArray[np.int64], most: int, fewest: int
) -> NDArray[np.bool_]:
    """
    Pick about `most` points of each group, or all of smaller ones, by their coordinates alone.

    Groups of fewer than `fewest` points have none.
    """
    words = np.ascontiguousarray(points[:, :2]).view(np.uint64)
    mixed = words[:, 0] * _GOLDEN + words[:, 1]
    mixed ^= mixed >> np.uint64(31)
    mixed *= _MIX
    mixed ^= mixed >> np.uint64(29)
    mixed *= _MIX
    share = (mixed >> np.uint64(11)).astype(np.float64) / 2.0**53
    own = np.where(group >= 0, size[group], 0) if len(size) else np.zeros(len(group), dtype=np.int64)
    return (own >= max(fewest, 1)) & (share * own < most)


@kernel
def add_directions(pulses, cells, group, is_probe, spacing, by_time, sums):  # type: ignore[no-untyped-def]
    """
    Add up (cos 2φ, sin 2φ, number of probes) of the directions φ to the nearest neighbours, group by group.

    The two nearest count in full and farther ones less and less, so that on a lattice, where many are
    equally near, all of them count.
    """
    runs = np.empty((3, 2), dtype=np.int64)
    near = np.empty((MAX_NEAR, 3))
    for cell in range(len(cells.numbers)):
        is_found = False
        for k in range(cells.first[cell], cells.first[cell + 1]):
            i = cells.rows[k]
            if not is_probe[i]:
                continue
            if not is_found:
                runs, is_found = first_windows(cells.numbers, cells.n_columns, 1, cell), True
            count, second = _gather(pulses, cells, runs, group, i, spacing, by_time, near)
            if second < np.inf:
                cosine, sine = _mean_direction(near[:count], second)
                sums[group[i], 0] += np.int64(UNIT * cosine)
                sums[group[i], 1] += np.int64(UNIT * sine)
                sums[group[i], 2] += 1


@kernel
def steps_along(pulses, cells, group, is_probe, spacing, by_time, axis, step, begin, end):  # type: ignore[no-untyped-def]
    """
    Write each probe's mean distance along its line to the nearest neighbours on it, of cells begin to end.
    """
    runs = np.empty((3, 2), dtype=np.int64)
    near = np.empty((MAX_NEAR, 3))
    for cell in range(begin, end):
        is_found = False
        for k in range(cells.first[cell], cells.first[cell + 1]):
            i = cells.rows[k]
            if not is_probe[i]:
                continue
            if not is_found:
                runs, is_found = first_windows(cells.numbers, cells.n_columns, 1, cell), True
            count, second = _gather(pulses, cells, runs, group, i, spacing, by_time, near)
            if second < np.inf:
                step[i] = spacing * _mean_step(near[:count], second, axis[group[i]], spacing)


@kernel
def lines_beside(pulses, cells, group, is_probe, spacing, axis, along, sides, begin, end):  # type: ignore[no-untyped-def]
    """Write each probe's distance to the next line on its left and on its right, of cells begin to end."""
    runs, near = np.empty((2 * REACH + 1, 2), dtype=np.int64), np.empty(2)
    for cell in range(begin, end):
        is_found = False
        for k in range(cells.first[cell], cells.first[cell + 1]):
            i = cells.rows[k]
            if not is_probe[i] or not along[group[i]] > 0.0:
                continue
            if not is_found:
                runs, is_found = first_windows(cells.numbers, cells.n_columns, REACH, cell), True
            cos, sin = axis[group[i]]
            step = along[group[i]]
            least = OFF_LINE * spacing * spacing / step
            near[0], near[1] = np.inf, np.inf
            for run in range(len(runs)):
                for m in range(cells.first[runs[run, 0]], cells.first[runs[run, 1]]):
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
def _are_mates(pulses, group, i, j):  # type: ignore[no-untyped-def]
    """Whether two points are of one group and strip."""
    return group[i] == group[j] and (len(pulses.strip) == 0 or pulses.strip[i] == pulses.strip[j])


@kernel
def _gather(pulses, cells, runs, group, i, spacing, by_time, near):  # type: ignore[no-untyped-def]
    """
    Write a point's neighbours (dx, dy, squared distance in time or in plan) to `near`.

    Returns how many there are and the second smallest distance, infinite where there is none. Where there is
    no more room, those that count least are not written any more.
    """
    count, nearest, second = 0, np.inf, np.inf
    same = (SAME_PULSE * spacing) ** 2
    points = pulses.points
    x, y = points[i, 0], points[i, 1]
    for run in range(len(runs)):
        for m in range(cells.first[runs[run, 0]], cells.first[runs[run, 1]]):
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
            if count == len(near):
                count = _keep_near(near, LAST * second)
            if count < len(near):
                near[count, 0], near[count, 1], near[count, 2] = dx, dy, far
                count += 1
    return count, second


@kernel
def _keep_near(near, limit):  # type: ignore[no-untyped-def]
    """Move the neighbours within a squared distance to the front and return their number."""
    count = 0
    for k in range(len(near)):
        if near[k, 2] <= limit:
            near[count, 0], near[count, 1], near[count, 2] = near[k, 0], near[k, 1], near[k, 2]
            count += 1
    return count


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
    """
    Return the mean distance along an axis of the nearest neighbours that lie on it [spacings], NaN if none.
    """
    total, count = 0, 0
    for k in range(len(near)):
        dx, dy = near[k, 0], near[k, 1]
        along = abs(dx * axis[0] + dy * axis[1])
        if near[k, 2] <= second * TIE and along >= ON_LINE * math.hypot(dx, dy):
            total += np.int64(UNIT * along / spacing)
            count += 1
    return total / UNIT / count if count > 0 else np.nan
