"""
Scan lines from what a file says of the scan: time, direction flag, angle, or the order of its points alone.

"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.ground_filter.profiles import MAX_STRIPS, Profiles, sorted_profiles

#: Points whose steps give the direction of the lines; headings hold at least that long.
BLOCK = 16384
#: A line turns where it comes back by so many median steps, and at least by so many metres: the returns of an
#: oblique pulse jump to and fro by less.
TURN_STEPS, MIN_TURN = 3.0, 5.0
#: Likewise for the scan angle, in median changes and degrees.
MIN_ANGLE_TURN = 0.5
#: A step further than this is no neighbour's: another line begins [multiples of the spacing].
MAX_STEP = 20.0
#: In a scan's order the median step is at most so many spacings,
MAX_MEDIAN_STEP = 4.0
#: a line, weighted by points, at least so many spacings long
MIN_LENGTH = 15.0
#: and the way along it no longer than so many times its extent.
MAX_DETOUR = 4.0


@dataclass(frozen=True, eq=False)
class ScanLines:
    """
    Which scan line each point lies on, and where on it.

    Attributes
    ----------
    line : ndarray of shape (n_points,)
        Number of the line, in the order of the scan.
    way : ndarray of shape (n_points,)
        Place along the direction of the lines [m].

    """

    line: NDArray[np.float64]
    way: NDArray[np.float64]

    def profiles(self, points: NDArray[np.float64], rows: NDArray[np.intp]) -> Profiles:
        """
        Return the lines as profiles of some of the points, numbered as in `rows`.

        """
        return sorted_profiles(self.line[rows], self.way[rows], points[rows, :2])


def find_scan_lines(
    points: NDArray[np.float64],
    spacing: float,
    *,
    gps_time: NDArray[Any] | None = None,
    scan_angle: NDArray[Any] | None = None,
    scan_direction_flag: NDArray[Any] | None = None,
    point_source_id: NDArray[Any] | None = None,
) -> ScanLines | None:
    """
    Find the scan lines of a cloud, or that its order is none of a scan.

    Points are brought into the order of their times, strip by strip, where they have times, and are taken in
    the order given otherwise. A line ends where the direction flag changes, where the scan angle turns, or
    where the way from point to point turns back: the first that gives long, straight lines counts.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        In the order of the file [m].
    spacing : float
        Spacing of the points [m].
    gps_time, scan_angle, scan_direction_flag, point_source_id : ndarray of shape (n_points,), optional
        Columns of the file [s], [deg].

    Returns
    -------
    ScanLines or None
        None if the order is not that of a scan: shuffled, or sorted by tiles or by a curve.

    """
    if len(points) < 2:
        return None
    order = _order_in_time(points, gps_time, point_source_id)
    ordered = points if order is None else points[order]
    steps = np.diff(ordered[:, :2], axis=0)
    step = np.hypot(steps[:, 0], steps[:, 1])
    median = float(np.median(step))
    if median > MAX_MEDIAN_STEP * spacing:
        return None
    jump = step > MAX_STEP * spacing
    if point_source_id is not None:
        strip = point_source_id if order is None else point_source_id[order]
        jump |= strip[1:] != strip[:-1]
    way = _way(steps, jump)
    for turns in _turns(order, scan_direction_flag, scan_angle, way, median):
        ends = jump | turns
        lines = np.concatenate(([0], np.cumsum(ends)))
        if lines[-1] < MAX_STRIPS and _is_scan(lines, way, step, ends, spacing):
            return _by_row(order, lines.astype(np.float64), way)
    return None


def _by_row(order: NDArray[np.intp] | None, line: NDArray[np.float64], way: NDArray[np.float64]) -> ScanLines:
    """
    Return lines found in an order as those of the rows.

    """
    if order is None:
        return ScanLines(line, way)
    found = np.empty((2, len(order)))
    found[:, order] = line, way
    return ScanLines(found[0], found[1])


def _order_in_time(
    points: NDArray[np.float64], gps_time: NDArray[Any] | None, strip: NDArray[Any] | None
) -> NDArray[np.intp] | None:
    """
    Return the rows by strip and time, None where neither is known; the returns of a pulse from the top down.

    """
    order = None
    if gps_time is not None and np.isfinite(gps_time).all() and gps_time.min() < gps_time.max():
        order = np.argsort(gps_time, kind="stable")
        _sort_pulses(order, np.asarray(gps_time, dtype=np.float64), points)
    if strip is not None and (strip != strip[0]).any():
        by_strip = np.argsort(strip if order is None else strip[order], kind="stable")
        order = by_strip if order is None else order[by_strip]
    return order


def _turns(
    order: NDArray[np.intp] | None,
    flag: NDArray[Any] | None,
    angle: NDArray[Any] | None,
    way: NDArray[np.float64],
    median_step: float,
) -> Iterator[NDArray[np.bool_]]:
    """
    Yield for each way of telling lines apart whether one ends between two points.

    """
    if flag is not None:
        flag = flag if order is None else flag[order]
        yield flag[1:] != flag[:-1]
    if angle is not None and np.isfinite(angle).all():
        angle = np.asarray(angle if order is None else angle[order], dtype=np.float64)
        yield _turning_points(angle, MIN_ANGLE_TURN)
    yield _turning_points(way, max(TURN_STEPS * median_step, MIN_TURN))


def _way(steps: NDArray[np.float64], jump: NDArray[np.bool_]) -> NDArray[np.float64]:
    """
    Return how far each point lies along the direction of the lines [m]; jumps count as no step.

    The direction is the main axis of the steps, whichever way they go, block by block.

    """
    steps = np.where(jump[:, None], 0.0, steps)
    travelled = np.zeros(len(steps) + 1)
    axis = np.array([1.0, 0.0])
    for first in range(0, len(steps), BLOCK):
        block = steps[first : first + BLOCK]
        main = np.linalg.eigh(block.T @ block)[1][:, 1]
        axis = main if main @ axis >= 0 else -main
        travelled[first + 1 : first + 1 + len(block)] = block @ axis
    return np.cumsum(travelled)


def _is_scan(
    lines: NDArray[np.int64],
    way: NDArray[np.float64],
    step: NDArray[np.float64],
    ends: NDArray[np.bool_],
    spacing: float,
) -> bool:
    """
    Whether most points lie on lines that lead somewhere without detours.

    """
    first = np.flatnonzero(np.concatenate(([True], ends)))
    extent = np.maximum.reduceat(way, first) - np.minimum.reduceat(way, first)
    path = np.where(ends, 0.0, step).sum()
    length = float(np.bincount(lines) @ extent / len(lines))
    return length >= MIN_LENGTH * spacing and path <= MAX_DETOUR * extent.sum()


@njit(cache=True, nogil=True)
def _sort_pulses(order, gps_time, points):  # type: ignore[no-untyped-def]
    """
    Sort rows of equal times by elevation from the top, then by x and y, in place.

    """
    begin = 0
    for end in range(1, len(order) + 1):
        if end < len(order) and gps_time[order[end]] == gps_time[order[begin]]:
            continue
        for k in range(begin + 1, end):
            row, j = order[k], k
            while j > begin and _above(points[row], points[order[j - 1]]):
                order[j] = order[j - 1]
                j -= 1
            order[j] = row
        begin = end


@njit(cache=True, nogil=True)
def _above(p, q):  # type: ignore[no-untyped-def]
    """
    Whether p lies higher than q, ties broken by x, then y.

    """
    if p[2] != q[2]:
        return p[2] > q[2]
    if p[0] != q[0]:
        return p[0] < q[0]
    return p[1] < q[1]


@njit(cache=True, nogil=True)
def _turning_points(value, back):  # type: ignore[no-untyped-def]
    """
    Mark the steps after which a signal, having gone one way, comes back by more than `back`.

    """
    turns = np.zeros(max(len(value) - 1, 0), dtype=np.bool_)
    low, high, far, heading = 0, 0, 0, 0
    for i in range(1, len(value)):
        if heading == 0:
            low = i if value[i] < value[low] else low
            high = i if value[i] > value[high] else high
            if value[i] - value[low] > back:
                heading, far = 1, i
            elif value[high] - value[i] > back:
                heading, far = -1, i
        elif (value[i] - value[far]) * heading >= 0.0:
            far = i
        elif (value[far] - value[i]) * heading > back:
            turns[far] = True
            heading, far = -heading, i
    return turns
