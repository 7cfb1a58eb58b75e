"""
From the walls of a ring to its corners.

"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.regularisation.division import Division
from lidar_buildings.core.regularisation.moments import running_sums
from lidar_buildings.core.regularisation.samples import RingSamples
from lidar_buildings.core.regularisation.walls import (
    CENTRE_X,
    CENTRE_Y,
    N_SHAPE,
    RADIUS,
    fit_wall,
    foot_on,
    move_out,
    nearest_meeting,
    offset_of,
    travel_at,
)

#: Walls whose directions differ by less go on in one direction, unless they are so long that it shows [rad].
_PARALLEL = np.deg2rad(15.0)
#: Straight walls whose directions differ by less are parallel: they meet in a step, not in a corner [rad].
_NO_CORNER = np.deg2rad(2.0)
#: A corner may lie this far from where the ring turns from one wall to the next [smallest steps],
_MAX_CORNER_SHIFT = 2.5
#: or so many times the gap between the last sample of the one and the first of the other.
_MAX_GAP_SHIFT = 0.8
#: Corners of walls that were moved lie so many times farther from the samples.
_MOVED = 1.5
#: Walls and steps that are left of this length, when walls were moved, are kept [smallest steps].
_LEAST_LEFT = 0.7
#: Ends of an arc and its neighbour that lie closer to each other are one corner [smallest steps].
_SMOOTH = 1.0


class Fit(NamedTuple):
    """
    How walls are fitted and which details are kept.

    Attributes
    ----------
    angles : ndarray of shape (n_directions,)
        Directions of the walls' normals [rad].
    direction_weight : float
        Weight of these directions, in multiples of the wall's own samples.
    min_step : float
        Smallest step or wall that is kept [m].

    """

    angles: NDArray[np.float64]
    direction_weight: float
    min_step: float


class WalledRing(NamedTuple):
    """
    A ring's walls with what joins them; no walls where no ring is left.

    Attributes
    ----------
    first, last, kind : ndarray of int64, shape (n_walls,)
        As in `Division`; samples of walls that were dropped belong to none.
    shape : ndarray of shape (n_walls, 5)
        See `walls.ANGLE` to `walls.RADIUS`.
    joints : ndarray of shape (n_walls, 2, 2)
        The corner between each wall and the next, given twice, or the two ends of the step between them [m].

    """

    first: NDArray[np.int64]
    last: NDArray[np.int64]
    kind: NDArray[np.int64]
    shape: NDArray[np.float64]
    joints: NDArray[np.float64]


def assemble(samples: RingSamples, division: Division, fit: Fit) -> WalledRing:
    """
    Fit the walls of a division and join them.

    Consecutive walls are intersected; parallel ones are joined by a perpendicular step, or made one where
    the step is too small. A wall that comes out too short, or the wrong way round, is dropped, the worst
    one first, until all are long enough.

    """
    return WalledRing(
        *_assembled(
            samples.points,
            samples.weights,
            samples.bears,
            division.first,
            division.last,
            division.kind,
            *fit,
        )
    )


def through_the_points(samples: RingSamples, walled: WalledRing, fit: Fit) -> tuple[WalledRing, float]:
    """
    Move walls from the bearing points to the middle of all points on them; also return how far, in the mean.

    Walls are found by the points that bear the ring, the outermost ones; the line of least squares through
    all points of a wall, as Sampath & Shan (2007) adjust it, lies inside.

    """
    offsets = _mean_offsets(samples.ring, samples.is_on_wall, samples.rows, len(samples.points), *walled[:4])
    lengths = np.hypot(*(walled.joints[:, 0] - np.roll(walled.joints[:, 1], 1, axis=0)).T)
    moved = _moved(samples.points, *walled[:4], offsets, fit.min_step)
    whole = float(lengths.sum())
    return WalledRing(*moved), float(offsets @ lengths) / whole if whole > 0 else 0.0


def moved_out(samples: RingSamples, walled: WalledRing, fit: Fit, distance: float) -> WalledRing:
    """
    Move all walls away from the building.

    """
    distances = np.full(len(walled.first), distance)
    return WalledRing(*_moved(samples.points, *walled[:4], distances, fit.min_step))


@njit(cache=True, nogil=True)
def _mean_offsets(ring, is_on_wall, rows, n_samples, first, last, kind, shape):  # type: ignore[no-untyped-def]
    """
    Return how far outside each wall its points lie in the mean, negative inside [m].

    """
    n = len(ring)
    offsets = np.zeros(len(first))
    for i in range(len(first)):
        row, end = rows[first[i]], rows[(last[i] - 1) % n_samples]
        before, behind = ring[(row - 1) % n], ring[(end + 1) % n]
        total, count = 0.0, 0
        while True:
            if is_on_wall[row]:
                dx, dy = behind[0] - before[0], behind[1] - before[1]
                total += offset_of(shape[i], dx, dy, ring[row, 0], ring[row, 1])
                count += 1
            if row == end:
                break
            row = row + 1 if row + 1 < n else 0
        if count:
            offsets[i] = total / count
    return offsets


@njit(cache=True, nogil=True)
def _moved(points, first, last, kind, shape, distances, min_step):  # type: ignore[no-untyped-def]
    """
    Move each wall by its distance and join them anew; steps and walls that shrink by it too much are dropped.

    """
    m, n = len(first), len(points)
    first, last, kind, shape = first.copy(), last.copy(), kind.copy(), shape.copy()
    for i in range(m):
        a, b = (first[i] - 1) % n, last[i] % n
        move_out(shape[i], points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], distances[i])
    joints = np.zeros((m, 2, 2))
    while m > 1:
        for i in range(m):
            joints[i] = _joint(points, first, last, shape, i, (i + 1) % m, _MOVED * min_step)
        spoilt = _spoilt(points, first, last, shape, joints, m, _LEAST_LEFT * min_step)
        if spoilt < 0 or m <= 3:
            break
        m = _dropped(first, last, kind, shape, m, spoilt)
    return first[:m], last[:m], kind[:m], shape[:m], joints[:m]


@njit(cache=True, nogil=True)
def _spoilt(points, first, last, shape, joints, m, least):  # type: ignore[no-untyped-def]
    """
    Return a wall that is too short, or the shorter one beside a step that is too small, −1 if there is none.

    """
    for i in range(m):
        k, before = (i + 1) % m, i - 1 if i else m - 1
        if _length(points, first, last, shape, i, joints[before, 1], joints[i, 0]) < least:
            return i
        step = np.hypot(joints[i, 0, 0] - joints[i, 1, 0], joints[i, 0, 1] - joints[i, 1, 1])
        if 0.0 < step < least:
            shorter = _extent(points, first[i], last[i]) < _extent(points, first[k], last[k])
            return i if shorter else k
    return -1


@njit(cache=True, nogil=True)
def _assembled(points, weights, bears, first, last, kind, angles, direction_weight, min_step):  # type: ignore[no-untyped-def]
    """
    Fit, join, drop and fit again until all walls are long enough.

    """
    sums = running_sums(points, weights)
    first, last, kind = first.copy(), last.copy(), kind.copy()
    m, n = len(first), len(points)
    shape = np.empty((m, N_SHAPE))
    for i in range(m):
        # Walls begin in the first round, so that merged ones end in the second, as far as the sums reach.
        first[i], last[i] = first[i] % n, first[i] % n + last[i] - first[i]
        shape[i] = fit_wall(
            points, weights, bears, sums, first[i], last[i], kind[i], angles, direction_weight
        )
    joints = np.zeros((m, 2, 2))
    while True:
        m = _merge_parallels(
            points,
            weights,
            bears,
            sums,
            first,
            last,
            kind,
            shape,
            m,
            angles,
            direction_weight,
            min_step,
        )
        if m == 1 and shape[0, RADIUS] != 0 and last[0] - first[0] >= len(points):
            break
        if m < 2:
            m = 0
            break
        for i in range(m):
            joints[i] = _joint(points, first, last, shape, i, (i + 1) % m, min_step)
        shortest, length = 0, np.inf
        for i in range(m):
            own = _length(points, first, last, shape, i, joints[i - 1 if i else m - 1, 1], joints[i, 0])
            if own < length:
                shortest, length = i, own
        if length >= min_step:
            break
        m = _dropped(first, last, kind, shape, m, shortest)
    return first[:m], last[:m], kind[:m], shape[:m], joints[:m]


@njit(cache=True, nogil=True)
def _dropped(first, last, kind, shape, m, i):  # type: ignore[no-untyped-def]
    """
    Close the rows over a wall; return how many are left.

    """
    for k in range(i, m - 1):
        first[k], last[k], kind[k] = first[k + 1], last[k + 1], kind[k + 1]
        shape[k] = shape[k + 1]
    return m - 1


@njit(cache=True, nogil=True)
def _merge_parallels(  # type: ignore[no-untyped-def]
    points, weights, bears, sums, first, last, kind, shape, m, angles, direction_weight, min_step
):
    """
    Make consecutive parallel walls one where the step between them is too small; return how many are left.

    """
    n, i = len(points), 0
    while m > 1 and i < m:
        k = (i + 1) % m
        if not _is_continued(points, first, last, shape, i, k, min_step):
            i += 1
            continue
        if last[k] - first[k] > last[i] - first[i]:
            kind[i] = kind[k]
        end = last[k]
        while end <= first[i]:
            end += n
        last[i] = end
        shape[i] = fit_wall(
            points, weights, bears, sums, first[i], last[i], kind[i], angles, direction_weight
        )
        m = _dropped(first, last, kind, shape, m, k)
        i = max(i - 1, 0) if k else 0
    return m


@njit(cache=True, nogil=True)
def _is_continued(points, first, last, shape, i, k, min_step):  # type: ignore[no-untyped-def]
    """
    Whether a wall goes on as the next one in the same direction with hardly a step.

    """
    if shape[i, RADIUS] != 0 or shape[k, RADIUS] != 0:
        return False
    x, y, _ = _turning_point(points, first, last, i, k)
    turn = _turn(points, first, last, shape, i, k, x, y)
    shorter = min(_extent(points, first[i], last[i]), _extent(points, first[k], last[k]))
    if turn > _PARALLEL or np.sin(turn) * shorter >= min_step:
        return False
    ax, ay = foot_on(shape[i], x, y)
    bx, by = foot_on(shape[k], x, y)
    return np.hypot(ax - bx, ay - by) < min_step


@njit(cache=True, nogil=True)
def _extent(points, first, last):  # type: ignore[no-untyped-def]
    """
    Return how far the first and the last sample of a wall are apart [m].

    """
    a, b = first % len(points), (last - 1) % len(points)
    return np.hypot(points[a, 0] - points[b, 0], points[a, 1] - points[b, 1])


@njit(cache=True, nogil=True)
def _turn(points, first, last, shape, i, k, x, y):  # type: ignore[no-untyped-def]
    """
    Return the angle by which the ring turns from one wall to the next, 0 to π [rad].

    """
    ax, ay = _travel(points, first, last, shape, i, x, y)
    bx, by = _travel(points, first, last, shape, k, x, y)
    return np.arccos(min(max(ax * bx + ay * by, -1.0), 1.0))


@njit(cache=True, nogil=True)
def _travel(points, first, last, shape, i, x, y):  # type: ignore[no-untyped-def]
    """
    Return the unit vector along a wall in the ring's sense near a point.

    """
    n = len(points)
    a, b = (first[i] - 1) % n, last[i] % n
    return travel_at(shape[i], points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], x, y)


@njit(cache=True, nogil=True)
def _turning_point(points, first, last, i, k):  # type: ignore[no-untyped-def]
    """
    Return the middle between the last sample of a wall and the first of the next, and how far they are apart.

    """
    n = len(points)
    a, b = (last[i] - 1) % n, first[k] % n
    return (
        0.5 * (points[a, 0] + points[b, 0]),
        0.5 * (points[a, 1] + points[b, 1]),
        np.hypot(points[a, 0] - points[b, 0], points[a, 1] - points[b, 1]),
    )


@njit(cache=True, nogil=True)
def _joint(points, first, last, shape, i, k, min_step):  # type: ignore[no-untyped-def]
    """
    Return the corner between two walls twice, or the two ends of the step between them.

    """
    joint = np.empty((2, 2))
    x, y, gap = _turning_point(points, first, last, i, k)
    turn = _turn(points, first, last, shape, i, k, x, y)
    is_bent = shape[i, RADIUS] != 0 or shape[k, RADIUS] != 0
    if (_PARALLEL if is_bent else _NO_CORNER) < turn < np.pi - _PARALLEL:
        mx, my, meet = nearest_meeting(shape[i], shape[k], x, y)
        if meet and np.hypot(mx - x, my - y) <= max(_MAX_CORNER_SHIFT * min_step, _MAX_GAP_SHIFT * gap):
            joint[:, 0], joint[:, 1] = mx, my
            return joint
    joint[0] = foot_on(shape[i], x, y)
    joint[1] = foot_on(shape[k], x, y)
    if (
        is_bent
        and turn <= _PARALLEL
        and np.hypot(joint[0, 0] - joint[1, 0], joint[0, 1] - joint[1, 1]) <= _SMOOTH * min_step
    ):
        joint[0] = joint[1] = 0.5 * (joint[0] + joint[1])
    return joint


@njit(cache=True, nogil=True)
def _length(points, first, last, shape, i, start, end):  # type: ignore[no-untyped-def]
    """
    Return the length of a wall between its ends in the ring's sense, negative if they are in the wrong order.

    """
    if shape[i, RADIUS] == 0:
        tx, ty = _travel(points, first, last, shape, i, start[0], start[1])
        return (end[0] - start[0]) * tx + (end[1] - start[1]) * ty
    n = len(points)
    way = 0.0
    for s in range(first[i], last[i] - 1):
        a, b = s % n, (s + 1) % n
        way += np.hypot(points[a, 0] - points[b, 0], points[a, 1] - points[b, 1])
    radius = abs(shape[i, RADIUS])
    sweep = swept(shape[i], start, end)
    # Ends in the wrong order make a sweep of nearly once round where the samples speak of little.
    if sweep - way / radius > np.pi:
        sweep -= 2.0 * np.pi
    return sweep * radius


@njit(cache=True, nogil=True)
def swept(shape, start, end):  # type: ignore[no-untyped-def]
    """
    Return the angle of an arc from one point to another in its sense, 0 to 2π [rad].

    """
    a = np.arctan2(start[1] - shape[CENTRE_Y], start[0] - shape[CENTRE_X])
    b = np.arctan2(end[1] - shape[CENTRE_Y], end[0] - shape[CENTRE_X])
    return (b - a) % (2.0 * np.pi) if shape[RADIUS] > 0 else (a - b) % (2.0 * np.pi)
