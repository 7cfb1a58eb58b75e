"""Lines and arcs fitted to stretches of a ring: least squares in normal form."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.surfaces.ring_division.division import ARC, FREE
from lidar_buildings.core.surfaces.ring_division.moments import algebraic_circle, normal_angle, scatter_of

#: What is known of a wall's shape: a line x cos θ + y sin θ = ρ has a radius of 0; an arc's is positive where
#: the ring goes round it counter-clockwise, and negative where clockwise.
ANGLE, OFFSET, CENTRE_X, CENTRE_Y, RADIUS = range(5)
N_SHAPE = 5
#: Rounds of the adjustment of a circle; offsets are small against radii, so that few suffice.
_CIRCLE_ROUNDS = 8


@kernel
def fit_wall(points, bears, sums, first, last, kind, angles, direction_weight, shape):  # type: ignore[no-untyped-def]
    """
    Fit the line or arc of one wall.

    A wall along a direction is the line of the second step of Sampath & Shan (2007): one equation
    x cos θ + y sin θ − ρ = 0 per sample and one θ = direction with `direction_weight` times the weight that
    all samples together have for it.

    Parameters
    ----------
    points : ndarray
        Samples of the ring about the building's centre [m].
    bears : ndarray of bool, shape (n_samples,)
        Whether a sample is a point of the ring: only these lie on an arc, bridges cut it short.
    sums : ndarray
        Their running sums.
    first, last, kind : int
        The wall.
    angles : ndarray of shape (n_directions,)
        Directions of normals [rad].
    direction_weight : float
        Zero fits the samples alone, a large value keeps the direction.
    shape : ndarray of shape (5,)
        What comes out: see `ANGLE` to `RADIUS`.
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
        c, s = np.cos(angle), np.sin(angle)
        along = s * s * xx - 2.0 * c * s * xy + c * c * yy
        across = c * s * (yy - xx) + (c * c - s * s) * xy
        # Turning the line by δ lowers its offset at position t by t δ: linear for the small turns left.
        if along > 0:
            angle -= across / (along * (1.0 + direction_weight))
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


@kernel
def offset_of(shape, chord_x, chord_y, x, y):  # type: ignore[no-untyped-def]
    """Return how far a point lies outside a wall, negative inside, the building being on the left [m]."""
    if shape[RADIUS] != 0:
        away = np.hypot(x - shape[CENTRE_X], y - shape[CENTRE_Y]) - abs(shape[RADIUS])
        return away if shape[RADIUS] > 0 else -away
    c, s = np.cos(shape[ANGLE]), np.sin(shape[ANGLE])
    # The normal points to the left where the ring goes along (sin θ, −cos θ).
    side = -1.0 if chord_x * s - chord_y * c > 0 else 1.0
    return side * (x * c + y * s - shape[OFFSET])


@kernel
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
