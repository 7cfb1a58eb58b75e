"""Lines and arcs fitted to stretches of a ring, and how they meet: in a corner, in a step, or as one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.stages.regularisation.samples import RingSamples
from lidar_buildings.core.surfaces.ring_division import (
    ARC,
    FREE,
    Division,
    algebraic_circle,
    normal_angle,
    running_sums,
    scatter_of,
)

#: What is known of a wall's shape: a line x cos θ + y sin θ = ρ has a radius of 0; an arc's is positive where
#: the ring goes round it counter-clockwise, and negative where clockwise.
ANGLE, OFFSET, CENTRE_X, CENTRE_Y, RADIUS = range(5)
N_SHAPE = 5
#: Rounds of the adjustment of a circle; offsets are small against radii, so that few suffice.
_CIRCLE_ROUNDS = 8
#: Walls whose directions differ by less go on in one direction, unless they are so long that it shows [rad].
PARALLEL = np.deg2rad(15.0)
#: A corner may lie this far from where the ring turns by a right angle, in smallest steps or shortest walls,
#: and farther where it turns by less: squared offsets of a wall beside the ring are length³ sin² turn / 3.
_MAX_CORNER_SHIFT, _LEAST_CORNER_SHIFT = 2.5, 1.2
#: Ends of an arc and its neighbour that lie closer to each other are one corner [smallest steps].
_SMOOTH = 1.0


@kernel
def about_direction(xx, xy, yy, angle):  # type: ignore[no-untyped-def]
    """Return a scatter's sum of squares along a wall whose normal is given, and of products with across."""
    c, s = np.cos(angle), np.sin(angle)
    return s * s * xx - 2.0 * c * s * xy + c * c * yy, c * s * (yy - xx) + (c * c - s * s) * xy


@kernel
def fit_wall(points, bears, sums, first, last, kind, angles, stiffness, shape):  # type: ignore[no-untyped-def]
    """
    Fit the line or arc of one wall.

    A wall along a direction is the line of the second step of Sampath & Shan (2007): one equation
    x cos θ + y sin θ − ρ = 0 per sample and one θ = direction with a weight of `stiffness` [m²]. Zero fits
    the samples alone.

    `points` are the samples about the building's centre [m], `sums` their running sums, `first` and `last`
    the wall's samples; `bears` tells which are points of the ring, since bridges cut arcs short. Directions
    are those of normals [rad]. The shape, see `ANGLE` to `RADIUS`, is written to `shape`.
    """
    shape[:] = 0.0
    if kind == ARC:
        _fit_arc(points, bears, sums, first, last, shape)
        return
    _, x, y, xx, xy, yy = scatter_of(sums, first, last)
    if kind == FREE:
        angle = normal_angle(xx, xy, yy)
    else:
        angle = angles[kind]
        along, across = about_direction(xx, xy, yy, angle)
        # Turning the line by δ lowers its offset at position t by t δ: linear for the small turns left.
        if along > 0:
            angle -= across / (along + stiffness)
    shape[ANGLE] = angle
    shape[OFFSET] = x * np.cos(angle) + y * np.sin(angle)


@kernel
def _fit_arc(points, bears, sums, first, last, shape):  # type: ignore[no-untyped-def]
    """Fit a circle by the least squared distances of bearing points, from the algebraic one on."""
    n = len(points)
    x, y, radius, _ = algebraic_circle(sums, first, last)
    for _ in range(_CIRCLE_ROUNDS):
        # normal equations of the unit vectors (u, v) from the centre and of the misfits
        uu, uv, vv, u1, v1, n_bearing = 0.0, 0.0, 0.0, 0.0, 0.0, 0
        to_u, to_v, to_1 = 0.0, 0.0, 0.0
        for i in range(first, last):
            if not bears[i % n]:
                continue
            dx, dy = points[i % n, 0] - x, points[i % n, 1] - y
            distance = max(np.hypot(dx, dy), 1e-12)
            u, v, misfit = dx / distance, dy / distance, distance - radius
            uu, uv, vv, u1, v1 = uu + u * u, uv + u * v, vv + v * v, u1 + u, v1 + v
            to_u, to_v, to_1 = to_u + u * misfit, to_v + v * misfit, to_1 + misfit
            n_bearing += 1
        if n_bearing == 0:
            break
        damping = 1e-9 * (uu + vv + n_bearing)
        uu, share = uu + damping, uv / (uu + damping)
        vv, v1, to_v = vv + damping - share * uv, v1 - share * u1, to_v - share * to_u
        last_one = n_bearing + damping - u1 * u1 / uu - v1 * v1 / vv
        dr = (to_1 - u1 / uu * to_u - v1 / vv * to_v) / last_one
        dy = (to_v - v1 * dr) / vv
        dx = (to_u - uv * dy - u1 * dr) / uu
        if not np.isfinite(dx + dy + dr) or radius + dr <= 0:
            break
        x, y, radius = x + dx, y + dy, radius + dr
        if max(abs(dx), abs(dy), abs(dr)) < 1e-6 * radius:
            break
    turned = 0.0
    for i in range(first, last - 1):
        a, b = i % n, (i + 1) % n
        turned += (points[a, 0] - x) * (points[b, 1] - y) - (points[a, 1] - y) * (points[b, 0] - x)
    shape[CENTRE_X], shape[CENTRE_Y] = x, y
    shape[RADIUS] = radius if turned >= 0 else -radius


@kernel
def foot_on(shape, x, y):  # type: ignore[no-untyped-def]
    """Return the point of a wall that is nearest to another."""
    if shape[RADIUS] != 0:
        dx, dy = x - shape[CENTRE_X], y - shape[CENTRE_Y]
        distance = max(np.hypot(dx, dy), 1e-12)
        stretch = abs(shape[RADIUS]) / distance
        return shape[CENTRE_X] + dx * stretch, shape[CENTRE_Y] + dy * stretch
    c, s = np.cos(shape[ANGLE]), np.sin(shape[ANGLE])
    off = x * c + y * s - shape[OFFSET]
    return x - off * c, y - off * s


@kernel
def travel_at(shape, chord_x, chord_y, x, y):  # type: ignore[no-untyped-def]
    """Return the unit vector along a wall, in the ring's sense, nearest to a point."""
    if shape[RADIUS] != 0:
        dx, dy = x - shape[CENTRE_X], y - shape[CENTRE_Y]
        distance = max(np.hypot(dx, dy), 1e-12) * np.sign(shape[RADIUS])
        return -dy / distance, dx / distance
    tx, ty = -np.sin(shape[ANGLE]), np.cos(shape[ANGLE])
    if tx * chord_x + ty * chord_y < 0:
        return -tx, -ty
    return tx, ty


@inner_kernel
def offset_of(shape, chord_x, chord_y, x, y):  # type: ignore[no-untyped-def]
    """Return how far a point lies outside a wall, negative inside, the building being on the left [m]."""
    if shape[RADIUS] != 0:
        away = np.hypot(x - shape[CENTRE_X], y - shape[CENTRE_Y]) - abs(shape[RADIUS])
        return away if shape[RADIUS] > 0 else -away
    c, s = np.cos(shape[ANGLE]), np.sin(shape[ANGLE])
    # The normal points to the left where the ring goes along (sin θ, −cos θ).
    side = -1.0 if chord_x * s - chord_y * c > 0 else 1.0
    return side * (x * c + y * s - shape[OFFSET])


@inner_kernel
def move_out(shape, chord_x, chord_y, distance):  # type: ignore[no-untyped-def]
    """Move a wall away from the building, which is on its left, in place."""
    if shape[RADIUS] != 0:
        shape[RADIUS] += distance
    else:
        c, s = np.cos(shape[ANGLE]), np.sin(shape[ANGLE])
        shape[OFFSET] += -distance if chord_x * s - chord_y * c > 0 else distance


@kernel
def nearest_meeting(one, other, x, y):  # type: ignore[no-untyped-def]
    """Return where two walls meet, the nearest such point to another, and whether they meet at all."""
    if one[RADIUS] == 0 and other[RADIUS] == 0:
        sine = np.sin(other[ANGLE] - one[ANGLE])
        if abs(sine) < 1e-9:
            return 0.0, 0.0, False
        mx = one[OFFSET] * np.sin(other[ANGLE]) - other[OFFSET] * np.sin(one[ANGLE])
        my = other[OFFSET] * np.cos(one[ANGLE]) - one[OFFSET] * np.cos(other[ANGLE])
        return mx / sine, my / sine, True
    if one[RADIUS] != 0 and other[RADIUS] != 0:
        # The common chord of two circles is a line, and the circles meet it where they meet each other.
        dx, dy = other[CENTRE_X] - one[CENTRE_X], other[CENTRE_Y] - one[CENTRE_Y]
        distance = np.hypot(dx, dy)
        if distance == 0:
            return 0.0, 0.0, False
        along = 0.5 * (distance + (one[RADIUS] ** 2 - other[RADIUS] ** 2) / distance)
        arc, angle = one, np.arctan2(dy, dx)
        offset = (one[CENTRE_X] * dx + one[CENTRE_Y] * dy) / distance + along
    else:
        line, arc = (one, other) if one[RADIUS] == 0 else (other, one)
        angle, offset = line[ANGLE], line[OFFSET]
    c, s = np.cos(angle), np.sin(angle)
    off = arc[CENTRE_X] * c + arc[CENTRE_Y] * s - offset
    square = arc[RADIUS] ** 2 - off * off
    if square < 0:
        return 0.0, 0.0, False
    half = np.sqrt(square)
    fx, fy = arc[CENTRE_X] - off * c, arc[CENTRE_Y] - off * s
    # Of the two points, the one on the side of the point asked for.
    if -(x - fx) * s + (y - fy) * c < 0:
        half = -half
    return fx - half * s, fy + half * c, True


@inner_kernel
def extent_of(points, first, last):  # type: ignore[no-untyped-def]
    """Return how far the first and the last sample of a wall are apart [m]."""
    a, b = first % len(points), (last - 1) % len(points)
    return np.hypot(points[a, 0] - points[b, 0], points[a, 1] - points[b, 1])


@inner_kernel
def turn_at(points, first, last, shape, i, k, x, y):  # type: ignore[no-untyped-def]
    """Return the angle by which the ring turns from one wall to the next, 0 to π [rad]."""
    ax, ay = travel_of(points, first, last, shape, i, x, y)
    bx, by = travel_of(points, first, last, shape, k, x, y)
    return np.arccos(min(max(ax * bx + ay * by, -1.0), 1.0))


@inner_kernel
def travel_of(points, first, last, shape, i, x, y):  # type: ignore[no-untyped-def]
    """Return the unit vector along a wall in the ring's sense near a point."""
    n = len(points)
    a, b = (first[i] - 1) % n, last[i] % n
    return travel_at(shape[i], points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], x, y)


@inner_kernel
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


class Fit(NamedTuple):
    """How walls are fitted and which details are kept."""

    angles: NDArray[np.float64]  #: directions of the walls' normals [rad], shape (n_directions,)
    stiffness: float  #: weight of these directions beside samples: the variance of these over theirs [m²]
    min_step: float  #: smallest step that is kept [m]
    shortest: float  #: shortest wall, even where smaller steps are kept [m]
    chord_error: float  #: largest distance of an arc from its chords [m]
    #: What a wall's own line has to save in squared offsets beside one that other walls lie on [m²].
    line_cost: float


class WalledRing(NamedTuple):
    """A ring's walls with what joins them; no walls where no ring is left."""

    #: As in `Division`; samples of walls that were dropped belong to none, shape (n_walls,).
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    kind: NDArray[np.int64]
    shape: NDArray[np.float64]  #: see `walls.ANGLE` to `walls.RADIUS`, shape (n_walls, 5)
    #: The corner between each wall and the next, given twice, or the two ends of the step between them [m],
    #: shape (n_walls, 2, 2).
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
            fit.angles,
            fit.stiffness,
            fit.min_step,
            fit.shortest,
        )
    )


@kernel
def _assembled(points, weights, bears, first, last, kind, angles, stiffness, min_step, shortest):  # type: ignore[no-untyped-def]
    """Fit, join, drop and fit again until all walls are long enough."""
    sums = running_sums(points, weights)
    first, last, kind = first.copy(), last.copy(), kind.copy()
    m, n = len(first), len(points)
    shape = np.empty((m, N_SHAPE))
    for i in range(m):
        # Walls begin in the first round, so that merged ones end in the second, as far as the sums reach.
        first[i], last[i] = first[i] % n, first[i] % n + last[i] - first[i]
        fit_wall(points, bears, sums, first[i], last[i], kind[i], angles, stiffness, shape[i])
    joints = np.zeros((m, 2, 2))
    while True:
        m = _merge_parallels(points, bears, sums, first, last, kind, shape, m, angles, stiffness, min_step)
        if m == 1 and shape[0, RADIUS] != 0 and last[0] - first[0] >= len(points):
            break
        if m < 2:
            m = 0
            break
        for i in range(m):
            find_joint(points, first, last, shape, i, (i + 1) % m, min_step, shortest, joints[i])
        worst, length = 0, np.inf
        for i in range(m):
            own = length_of(points, first, last, shape, i, joints[i - 1 if i else m - 1, 1], joints[i, 0])
            if own < length:
                worst, length = i, own
        if length >= max(shortest, min_step):
            break
        m = close_rows(first, last, kind, shape, m, worst)
    return first[:m], last[:m], kind[:m], shape[:m], joints[:m]


@inner_kernel
def close_rows(first, last, kind, shape, m, i):  # type: ignore[no-untyped-def]
    """Close the rows over a wall; return how many are left."""
    for k in range(i, m - 1):
        first[k], last[k], kind[k] = first[k + 1], last[k + 1], kind[k + 1]
        for column in range(N_SHAPE):
            shape[k, column] = shape[k + 1, column]
    return m - 1


@kernel
def _merge_parallels(  # type: ignore[no-untyped-def]
    points, bears, sums, first, last, kind, shape, m, angles, stiffness, min_step
):
    """Make parallel walls one where the step between is too small; return how many are left."""
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
        fit_wall(points, bears, sums, first[i], last[i], kind[i], angles, stiffness, shape[i])
        m = close_rows(first, last, kind, shape, m, k)
        i = max(i - 1, 0) if k else 0
    return m


@inner_kernel
def _is_continued(points, first, last, shape, i, k, min_step):  # type: ignore[no-untyped-def]
    """Whether a wall goes on as the next one in the same direction with hardly a step."""
    if shape[i, RADIUS] != 0 or shape[k, RADIUS] != 0:
        return False
    x, y = turning_point(points, first, last, i, k)
    turn = turn_at(points, first, last, shape, i, k, x, y)
    shorter = min(extent_of(points, first[i], last[i]), extent_of(points, first[k], last[k]))
    if turn > PARALLEL or np.sin(turn) * shorter >= min_step:
        return False
    ax, ay = foot_on(shape[i], x, y)
    bx, by = foot_on(shape[k], x, y)
    return np.hypot(ax - bx, ay - by) < min_step
