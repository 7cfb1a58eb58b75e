"""How two walls of a ring meet: in a corner, in a step, or going on as one."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.stages.regularisation.walls import (
    CENTRE_X,
    CENTRE_Y,
    RADIUS,
    foot_on,
    nearest_meeting,
    travel_at,
)

#: Walls whose directions differ by less go on in one direction, unless they are so long that it shows [rad].
PARALLEL = np.deg2rad(15.0)
#: A corner may lie this far from where the ring turns by a right angle, in smallest steps or shortest walls,
#: and farther where it turns by less: squared offsets of a wall beside the ring are length³ sin² turn / 3.
_MAX_CORNER_SHIFT, _LEAST_CORNER_SHIFT = 2.5, 1.2
#: Ends of an arc and its neighbour that lie closer to each other are one corner [smallest steps].
_SMOOTH = 1.0


@kernel
def extent_of(points, first, last):  # type: ignore[no-untyped-def]
    """Return how far the first and the last sample of a wall are apart [m]."""
    a, b = first % len(points), (last - 1) % len(points)
    return np.hypot(points[a, 0] - points[b, 0], points[a, 1] - points[b, 1])


@kernel
def turn_at(points, first, last, shape, i, k, x, y):  # type: ignore[no-untyped-def]
    """Return the angle by which the ring turns from one wall to the next, 0 to π [rad]."""
    ax, ay = travel_of(points, first, last, shape, i, x, y)
    bx, by = travel_of(points, first, last, shape, k, x, y)
    return np.arccos(min(max(ax * bx + ay * by, -1.0), 1.0))


@kernel
def travel_of(points, first, last, shape, i, x, y):  # type: ignore[no-untyped-def]
    """Return the unit vector along a wall in the ring's sense near a point."""
    n = len(points)
    a, b = (first[i] - 1) % n, last[i] % n
    return travel_at(shape[i], points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], x, y)


@kernel
def turning_point(points, first, last, i, k):  # type: ignore[no-untyped-def]
    """Return the middle between the last sample of a wall and the first of the next."""
    n = len(points)
    a, b = (last[i] - 1) % n, first[k] % n
    return 0.5 * (points[a, 0] + points[b, 0]), 0.5 * (points[a, 1] + points[b, 1])


@kernel
def find_joint(points, first, last, shape, i, k, min_step, shortest, joint):  # type: ignore[no-untyped-def]
    """Write the corner between two walls twice, or the two ends of the step between them."""
    x, y = turning_point(points, first, last, i, k)
    turn = turn_at(points, first, last, shape, i, k, x, y)
    is_bent = shape[i, RADIUS] != 0 or shape[k, RADIUS] != 0
    if (PARALLEL if is_bent else 0.0) < turn < np.pi - PARALLEL:
        mx, my, meet = nearest_meeting(shape[i], shape[k], x, y)
        longest = max(_MAX_CORNER_SHIFT * min_step, _LEAST_CORNER_SHIFT * shortest)
        # The sharper a corner, the farther it would stick out beyond the points that speak for it.
        longest *= min(2.0 * np.sin(turn), 1.0) if turn > 0.5 * np.pi else np.sin(turn) ** (-2.0 / 3.0)
        if meet and np.hypot(mx - x, my - y) <= longest:
            joint[:, 0], joint[:, 1] = mx, my
            return
    ax, ay = foot_on(shape[i], x, y)
    bx, by = foot_on(shape[k], x, y)
    if is_bent and turn <= PARALLEL and np.hypot(ax - bx, ay - by) <= _SMOOTH * min_step:
        joint[:, 0], joint[:, 1] = 0.5 * (ax + bx), 0.5 * (ay + by)
    else:
        joint[0, 0], joint[0, 1], joint[1, 0], joint[1, 1] = ax, ay, bx, by


@kernel
def length_of(points, first, last, shape, i, start, end):  # type: ignore[no-untyped-def]
    """Return the length of a wall between its ends in the ring's sense; negative if a line's are swapped."""
    if shape[i, RADIUS] == 0:
        tx, ty = travel_of(points, first, last, shape, i, start[0], start[1])
        return (end[0] - start[0]) * tx + (end[1] - start[1]) * ty
    return swept(shape[i], start, end) * abs(shape[i, RADIUS])


@kernel
def swept(shape, start, end):  # type: ignore[no-untyped-def]
    """Return the angle of an arc from one point to another in its sense, 0 to 2π [rad]."""
    a = np.arctan2(start[1] - shape[CENTRE_Y], start[0] - shape[CENTRE_X])
    b = np.arctan2(end[1] - shape[CENTRE_Y], end[0] - shape[CENTRE_X])
    return (b - a) % (2.0 * np.pi) if shape[RADIUS] > 0 else (a - b) % (2.0 * np.pi)
