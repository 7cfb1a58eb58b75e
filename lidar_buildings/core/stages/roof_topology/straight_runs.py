"""Straight lines through the sides of cells, the longest first, in given directions."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.neighbours.few_rows import sort_rows
from lidar_buildings.core.stages.roof_topology.obstacles import stop

#: Bins across the lines, and how many a line takes up, in cells.
_BIN, _WINDOW = 0.5, 5
#: Sides within so many spacings of a line belong to it, and within so many no longer begin others.
_HALF_WIDTH, _TAKEN = 0.7, 1.3
#: Longest gap in a run in spacings, and least share of it that has sides.
_LONGEST_GAP, _LEAST_SUPPORT = 3.0, 0.5
#: Lines that stop a run lie within so many spacings of its ends, and so many of one another at least.
_CLOSED, _SHORTEST = 1.75, 2.0
#: Length of the shortest run in spacings.
LEAST_LENGTH = 2.0


def straight_runs(
    xy: FloatArray,
    upright: BoolArray,
    cell: float,
    angles: FloatArray,
    spacing: float,
    free: BoolArray,
    least_length: float = LEAST_LENGTH,
) -> tuple[FloatArray, IntArray]:
    """
    Find straight runs of sides of cells, the longest first.

    Parameters
    ----------
    xy : ndarray of shape (n_sides, 2)
        Middles of the sides, near the origin [m].
    upright : ndarray of shape (n_sides,), bool
        Which run north-south.
    cell : float
        Length of a side [m].
    angles : ndarray of shape (n_angles,)
        Directions to be tried [rad].
    spacing : float
        Point spacing [m].
    free : ndarray of shape (n_sides,), bool
        Which sides are still to be accounted for; those taken are cleared.
    least_length : float
        Length of the shortest run [spacings].

    Returns
    -------
    runs : ndarray of shape (n_runs, 4)
        Angle [rad], offset from the origin to the left of that direction, and both ends along it [m].
    run : ndarray of shape (n_sides,)
        Which run each side lies on, -1 = none.
    """
    run = np.full(len(xy), -1, dtype=np.int64)
    if not len(xy) or not len(angles):
        return np.zeros((0, 4)), run
    runs = np.empty((len(xy), 4))
    cosine, sine = np.cos(angles), np.sin(angles)
    left = np.flatnonzero(free)
    n_runs = _greedy(xy, upright, cell, cosine, sine, spacing, left, run, least_length * spacing, runs)
    free[run >= 0] = False
    # The first member of a run is the number of its angle until here.
    runs[:n_runs, 0] = angles[runs[:n_runs, 0].astype(np.int64)]
    return runs[:n_runs], run


def run_segments(runs: FloatArray) -> FloatArray:
    """Return the ends of runs, shape (n_runs, 2, 2) [m]."""
    along = np.column_stack([np.cos(runs[:, 0]), np.sin(runs[:, 0])])
    left = np.column_stack([-along[:, 1], along[:, 0]])
    return np.asarray((runs[:, 1:2] * left)[:, None] + runs[:, 2:, None] * along[:, None])


@kernel
def closing(runs, stops, spacing):  # type: ignore[no-untyped-def]
    """
    Return which runs go from one line to another.

    Parameters
    ----------
    runs : ndarray of shape (n_runs, 4)
        As returned by `straight_runs`.
    stops : ndarray of shape (n, 2, 2)
        Ends of the lines [m].
    spacing : float
        Point spacing [m].
    """
    closed = np.zeros(len(runs), dtype=np.bool_)
    for k in range(len(runs)):
        angle, offset, t0, t1 = runs[k, 0], runs[k, 1], runs[k, 2], runs[k, 3]
        ux, uy = math.cos(angle), math.sin(angle)
        low = stop(t0, -offset * uy, offset * ux, ux, uy, stops, _CLOSED * spacing, _CLOSED * spacing, -1)
        high = stop(t1, -offset * uy, offset * ux, ux, uy, stops, _CLOSED * spacing, _CLOSED * spacing, -1)
        closed[k] = not math.isnan(low) and not math.isnan(high) and high - low > _SHORTEST * spacing
    return closed


@kernel
def _greedy(xy, upright, cell, cosine, sine, spacing, left, run, least, runs):  # type: ignore[no-untyped-def]
    """
    Take the line with the longest sides near it, then its runs from the sides, and so on; return how many.

    The runs get the number of their direction in place of the angle. Only the sides `left` are looked at.
    """
    reach = 0.0
    for k in range(len(xy)):
        reach = max(reach, math.hypot(xy[k, 0], xy[k, 1]))
    size = _BIN * cell
    n_bins = 2 * int(reach / size + 2) + _WINDOW
    votes = np.zeros((len(cosine), n_bins))
    for k in left:
        _vote(votes, xy[k, 0], xy[k, 1], upright[k], cell, cosine, sine, size, 1.0)
    n_runs = 0
    rows = np.empty(len(xy), dtype=np.int64)
    t = np.empty(len(xy))
    most, place = np.full(len(cosine), np.inf), np.zeros(len(cosine), np.int64)
    known = np.zeros(len(cosine), np.bool_)
    while True:
        d = _peak(votes, most, place, known)
        b = place[d]
        if most[d] < least:
            break
        offset = (b + 0.5 * _WINDOW - n_bins // 2) * size
        for _ in range(2):
            n, offset = _members(
                xy, upright, cell, cosine[d], sine[d], offset, _HALF_WIDTH * spacing, left, rows, t
            )
        sort_rows(t, rows, n)
        begin, found = 0, False
        for m in range(1, n + 1):
            if m < n and t[m] - t[m - 1] <= _LONGEST_GAP * spacing:
                continue
            t0, t1 = t[begin] - 0.5 * cell, t[m - 1] + 0.5 * cell
            length = 0.0
            for i in range(begin, m):
                length += _along(upright[rows[i]], cell, cosine[d], sine[d])
            first, begin = begin, m
            if length < least or length < _LEAST_SUPPORT * (t1 - t0):
                continue
            # Its own sides are taken even where its mean offset has moved away: none is found twice.
            for i in range(first, m):
                run[rows[i]] = n_runs
            runs[n_runs, 0], runs[n_runs, 1], runs[n_runs, 2], runs[n_runs, 3] = d, offset, t0, t1
            n_left = _take(
                xy, upright, cell, cosine, sine, d, offset, t0, t1, spacing, left, run, n_runs, votes, size
            )
            left = left[:n_left]
            n_runs += 1
            known[:] = False
            found = True
        if not found:
            for k in range(b, b + _WINDOW):
                votes[d, k] = -1e9
            known[d] = False
    return n_runs


@inner_kernel
def _along(upright, cell, cosine, sine):  # type: ignore[no-untyped-def]
    return cell * (abs(sine) if upright else abs(cosine))


@inner_kernel
def _vote(votes, x, y, upright, cell, cosine, sine, size, sign):  # type: ignore[no-untyped-def]
    """Add a side to the line through it in every direction, or take it away."""
    middle = votes.shape[1] // 2
    for d in range(len(cosine)):
        b = math.floor((y * cosine[d] - x * sine[d]) / size) + middle
        votes[d, b] += sign * _along(upright, cell, cosine[d], sine[d])


@inner_kernel
def _peak(votes, most, place, known):  # type: ignore[no-untyped-def]
    """
    Return the direction with the window of most votes; which window that is, is in its place.

    Votes become fewer only: what a direction had before is no less than it has now, enough to pass it over.
    """
    while True:
        d = 0
        for other in range(1, len(most)):
            if most[other] > most[d] + 1e-9:
                d = other
        if known[d]:
            return d
        most[d], place[d], known[d] = 0.0, 0, True
        total = 0.0
        for b in range(_WINDOW - 1):
            total += votes[d, b]
        for b in range(votes.shape[1] - _WINDOW + 1):
            total += votes[d, b + _WINDOW - 1]
            if total > most[d] + 1e-9:
                most[d], place[d] = total, b
            total -= votes[d, b]


@inner_kernel
def _members(xy, upright, cell, cosine, sine, offset, half, left, rows, t):  # type: ignore[no-untyped-def]
    """Write the free sides near a line and their places along it; return how many, and their mean offset."""
    n, total, weight = 0, 0.0, 0.0
    for k in left:
        r = xy[k, 1] * cosine - xy[k, 0] * sine
        if abs(r - offset) <= half:
            rows[n] = k
            t[n] = xy[k, 0] * cosine + xy[k, 1] * sine
            w = _along(upright[k], cell, cosine, sine)
            total += w * r
            weight += w
            n += 1
    return n, total / weight if weight > 0.0 else offset


@inner_kernel
def _take(xy, upright, cell, cosine, sine, d, offset, t0, t1, spacing, left, run, number, votes, size):  # type: ignore[no-untyped-def]
    """Account for all sides near a run: they vote no more. Return how many are left."""
    n_left = 0
    for k in left:
        r = xy[k, 1] * cosine[d] - xy[k, 0] * sine[d]
        t = xy[k, 0] * cosine[d] + xy[k, 1] * sine[d]
        # Beside the ends of a run there may be corners: what lies there is left to other runs.
        inside = t0 + spacing <= t <= t1 - spacing
        near = abs(r - offset) <= (_TAKEN if inside else _HALF_WIDTH) * spacing
        if run[k] == number or (t0 <= t <= t1 and near):
            run[k] = number
            _vote(votes, xy[k, 0], xy[k, 1], upright[k], cell, cosine, sine, size, -1.0)
        else:
            left[n_left] = k
            n_left += 1
    return n_left
