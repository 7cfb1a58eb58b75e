"""
Scan lines from what a file says of the scan: time, direction flag, angle, or the order of its points alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.stages.ground_filter.scan_profiles.profiles import (
    MAX_STRIPS,
    Profiles,
    sorted_profiles,
)

# Chosen with `bench.ground.isprs`, `bench.ground.providers` and the scans of `test_scan_lines.py`.
#: Points whose steps give the direction of the lines; headings hold at least that long.
BLOCK = 16384
#: A line turns where it comes back by so many median steps, and at least by so many metres: the returns of an
#: oblique pulse jump to and fro by less.
TURN_STEPS, MIN_TURN = 3.0, 5.0
#: Likewise for the scan angle, in median changes and degrees.
MIN_ANGLE_TURN = 0.5
#: Steps that are looked at to find the median.
MAX_SAMPLE = 100_000
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
    """Which scan line each point lies on, and where on it."""

    line: NDArray[np.int32]  #: number of the line, in the order of the scan, shape (n_points,)
    #: Place along the direction of the lines, from the line's first point [m], shape (n_points,).
    way: NDArray[np.float32]

    def profiles(self, points: NDArray[np.float64], rows: NDArray[np.intp]) -> Profiles:
        """Return the lines as profiles of some of the points, numbered as in `rows`."""
        return sorted_profiles(self.line[rows].astype(float), self.way[rows].astype(float), points[rows, :2])


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
    n = len(points)
    if n < 2:
        return None
    order = _order_in_time(points, gps_time, point_source_id)
    order = np.arange(n) if order is None else order
    strip = np.zeros(n, dtype=np.uint8) if point_source_id is None else point_source_id
    step, jump, products = _steps(points, order, strip, MAX_STEP * spacing)
    # A sample is enough to know the median to a thousandth.
    median = float(np.median(step[:: 1 + n // MAX_SAMPLE]))
    if median > MAX_MEDIAN_STEP * spacing:
        return None
    way = _way(points, order, jump, _axes(products))
    for turns in _turns(order, scan_direction_flag, scan_angle, way, median):
        ends = jump | turns
        first = np.concatenate(([0], np.flatnonzero(ends) + 1))
        if len(first) < MAX_STRIPS and _is_scan(first, way, step, ends, spacing):
            return ScanLines(*_by_row(order, ends, way))
    return None


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
    order: NDArray[np.intp],
    flag: NDArray[Any] | None,
    angle: NDArray[Any] | None,
    way: NDArray[np.float64],
    median_step: float,
) -> Iterator[NDArray[np.bool_]]:
    """Yield for each way of telling lines apart whether one ends between two points."""
    if flag is not None:
        flag = flag[order]
        yield flag[1:] != flag[:-1]
    if angle is not None and np.isfinite(angle).all():
        yield _turning_points(np.asarray(angle[order], dtype=np.float64), MIN_ANGLE_TURN)
    yield _turning_points(way, max(TURN_STEPS * median_step, MIN_TURN))


def _axes(products: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return the main axis of each block's steps, whichever way they go; neighbouring blocks in like directions.
    """
    axes = np.empty((len(products), 2))
    last = np.array([1.0, 0.0])
    for k, (xx, xy, yy) in enumerate(products):
        main = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))[1][:, 1]
        last = axes[k] = main if main @ last >= 0 else -main
    return axes


def _is_scan(
    first: NDArray[np.intp],
    way: NDArray[np.float64],
    step: NDArray[np.float32],
    ends: NDArray[np.bool_],
    spacing: float,
) -> bool:
    extent = np.maximum.reduceat(way, first) - np.minimum.reduceat(way, first)
    length = float(np.diff(first, append=len(way)) @ extent) / len(way)
    path = float(np.sum(step, where=~ends, dtype=np.float64))
    return length >= MIN_LENGTH * spacing and path <= MAX_DETOUR * extent.sum()


@kernel
def _steps(points, order, strip, max_step):  # type: ignore[no-untyped-def]
    """
    Measure the steps from point to point [m], mark jumps, and sum up products of the others block by block.
    """
    n = len(order) - 1
    step, jump = np.empty(n, dtype=np.float32), np.empty(n, dtype=np.bool_)
    products = np.zeros((n // BLOCK + 1, 3))
    for i in range(n):
        p, q = order[i], order[i + 1]
        dx, dy = points[q, 0] - points[p, 0], points[q, 1] - points[p, 1]
        step[i] = math.hypot(dx, dy)
        jump[i] = step[i] > max_step or strip[p] != strip[q]
        if not jump[i]:
            products[i // BLOCK, 0] += dx * dx
            products[i // BLOCK, 1] += dx * dy
            products[i // BLOCK, 2] += dy * dy
    return step, jump, products


@kernel
def _way(points, order, jump, axes):  # type: ignore[no-untyped-def]
    """Return how far each point lies along the direction of the lines [m]; jumps count as no step."""
    way = np.zeros(len(order))
    for i in range(len(jump)):
        p, q, axis = order[i], order[i + 1], axes[i // BLOCK]
        along = (points[q, 0] - points[p, 0]) * axis[0] + (points[q, 1] - points[p, 1]) * axis[1]
        way[i + 1] = way[i] + (0.0 if jump[i] else along)
    return way


@kernel
def _by_row(order, ends, way):  # type: ignore[no-untyped-def]
    """Return each row's line and its place on it, counted from the line's first point."""
    line, place = np.empty(len(order), dtype=np.int32), np.empty(len(order), dtype=np.float32)
    number, begin = 0, way[0]
    for i in range(len(order)):
        if i > 0 and ends[i - 1]:
            number, begin = number + 1, way[i]
        line[order[i]], place[order[i]] = number, way[i] - begin
    return line, place


@kernel
def _sort_pulses(order, gps_time, points):  # type: ignore[no-untyped-def]
    """Sort rows of equal times by elevation from the top, then by x and y, in place."""
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


@inner_kernel
def _above(p, q):  # type: ignore[no-untyped-def]
    if p[2] != q[2]:
        return p[2] > q[2]
    if p[0] != q[0]:
        return p[0] < q[0]
    return p[1] < q[1]


@kernel
def _turning_points(value, back):  # type: ignore[no-untyped-def]
    """Mark the steps after which a signal, having gone one way, comes back by more than `back`."""
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
