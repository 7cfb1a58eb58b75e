"""Profiles: scan lines, as far as a file tells them, and strips cut through a cloud."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel

#: Largest number of lines: 20 bits, which leave 32 of a double's 52 for the place along a line in the sort
#: key.
MAX_STRIPS = 2.0**20


@dataclass(frozen=True, eq=False)
class Profiles:
    """Every point of a cloud on one profile, and each profile in the order of travel."""

    rows: NDArray[np.intp]  #: rows of the cloud, profile after profile, shape (n_points,)
    #: Where each profile begins in `rows`; the last one is the number of points, shape (n_profiles + 1,).
    first: NDArray[np.intp]
    along: NDArray[np.float64]  #: distance along the profile, never falling within one [m], shape (n_points,)


def cut_profiles(points: NDArray[np.float64], width: float, direction_deg: float) -> Profiles:
    """
    Cut a cloud into parallel strips along a direction, from x towards y; each is a profile.

    Strips begin at multiples of `width` from the map origin, so that a cloud's tiles are cut alike; it is
    doubled until an enormous extent can be numbered. Points come in canonical order: those at one place along
    a strip stay as they are.
    """
    angle = math.radians(direction_deg)
    along = points[:, 0] * math.cos(angle) + points[:, 1] * math.sin(angle)
    across = points[:, 1] * math.cos(angle) - points[:, 0] * math.sin(angle)
    while len(points) and float(np.ptp(across)) / width > MAX_STRIPS:
        width *= 2.0
    strip = np.floor(across / width)
    return sorted_profiles(strip - strip.min(initial=0.0), along)


def sorted_profiles(
    line: NDArray[np.float64], along: NDArray[np.float64], xy: NDArray[np.float64] | None = None
) -> Profiles:
    """
    Order points by line, at most `MAX_STRIPS`, and within a line by their place along it.

    With `xy` distances are measured from point to point instead of by `along` [m].
    """
    if len(line) == 0:
        nothing = np.zeros(0, dtype=np.intp)
        return Profiles(nothing, np.zeros(1, dtype=np.intp), np.zeros(0))
    low = along.min()
    extent = max(float(along.max() - low), 1.0)
    # One key sorts several times faster than two; a line and 2^-32 of the extent fit into a double.
    rows = np.argsort(line + (along - low) / (1.001 * extent), kind="stable")
    ordered = line[rows]
    begins = np.flatnonzero(np.concatenate(([True], ordered[1:] != ordered[:-1])))
    first = np.append(begins, len(rows)).astype(np.intp)
    place = along[rows]
    if xy is not None:
        ordered = xy[rows]
        place = np.cumsum(np.hypot(*np.diff(ordered, axis=0, prepend=ordered[:1]).T))
    return Profiles(rows, first, place)


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

    - `points`, shape (n_points, 3): In the order of the file [m].
    - `spacing`: Spacing of the points [m].
    - `gps_time`, `scan_angle`, `scan_direction_flag`, `point_source_id`, shape (n_points,), optional: Columns
      of the file [s], [deg].

    Returned: None if the order is not that of a scan: shuffled, or sorted by tiles or by a curve.
    """
    n = len(points)
    if n < 2:
        return None
    order = _order_in_time(points, gps_time, point_source_id)
    moves = np.diff(points[order, :2], axis=0)
    step = np.hypot(moves[:, 0], moves[:, 1])
    # A sample is enough to know the median to a thousandth.
    median = float(np.median(step[:: 1 + n // MAX_SAMPLE]))
    if median > MAX_MEDIAN_STEP * spacing:
        return None
    jump = step > MAX_STEP * spacing
    if point_source_id is not None:
        jump |= np.diff(point_source_id[order]) != 0
    moves[jump] = 0.0
    way = np.concatenate(([0.0], np.cumsum(_along_lines(moves))))
    for turns in _turns(order, scan_direction_flag, scan_angle, way, median):
        ends = jump | turns
        first = np.concatenate(([0], np.flatnonzero(ends) + 1))
        if len(first) < MAX_STRIPS and _is_scan(first, way, step, ends, spacing):
            line, place = np.empty(n, dtype=np.int32), np.empty(n, dtype=np.float32)
            line[order] = np.repeat(np.arange(len(first)), np.diff(first, append=n))
            place[order] = way - way[first][line[order]]
            return ScanLines(line, place)
    return None


def _order_in_time(
    points: NDArray[np.float64], gps_time: NDArray[Any] | None, strip: NDArray[Any] | None
) -> NDArray[np.intp]:
    """Return the rows by strip and time, as far as known; the returns of a pulse from the top down."""
    order = np.arange(len(points))
    if gps_time is not None and np.isfinite(gps_time).all() and gps_time.min() < gps_time.max():
        order = np.argsort(gps_time, kind="stable")
        is_same = np.diff(gps_time[order]) == 0
        tied = np.flatnonzero(np.append(is_same, False) | np.append(False, is_same))
        rows = order[tied]
        order[tied] = rows[np.lexsort((points[rows, 1], points[rows, 0], -points[rows, 2], gps_time[rows]))]
    if strip is not None:
        order = order[np.argsort(strip[order], kind="stable")]
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


def _along_lines(moves: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far moves go along the main axis of their block; those beside it look in like directions."""
    x, y = moves.T
    products = np.add.reduceat(np.column_stack((x * x, x * y, x * y, y * y)), np.arange(0, len(x), BLOCK))
    axes = np.linalg.eigh(products.reshape(-1, 2, 2))[1][:, :, 1]
    last = np.array([1.0, 0.0])
    for k, main in enumerate(axes):
        last = axes[k] = main if main @ last >= 0 else -main
    return np.einsum("ij,ij->i", moves, np.repeat(axes, BLOCK, axis=0)[: len(x)])


def _is_scan(
    first: NDArray[np.intp],
    way: NDArray[np.float64],
    step: NDArray[np.float64],
    ends: NDArray[np.bool_],
    spacing: float,
) -> bool:
    extent = np.maximum.reduceat(way, first) - np.minimum.reduceat(way, first)
    length = float(np.diff(first, append=len(way)) @ extent) / len(way)
    path = float(step[~ends].sum())
    return length >= MIN_LENGTH * spacing and path <= MAX_DETOUR * extent.sum()


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
