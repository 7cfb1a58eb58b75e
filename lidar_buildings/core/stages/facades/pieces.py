"""Pieces of straight lines and arcs in patches of upright points: where walls may stand, and how far."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.stages.facades.curves import Curve, fit_curve
from lidar_buildings.core.stages.facades.upright import UprightPoints

Floats = NDArray[np.float64]

#: Points of a piece, at least: 1 m² of wall at 40 m.
MIN_POINTS = 12
#: Length of a piece, at least [m].
MIN_LENGTH = 0.5
#: Widest gap within a piece [m]: wider ones are closed when pieces are joined.
MAX_GAP = 1.0
#: Points on a curve lie within so many σ of the patch's roughness, and of this at least [m].
ON_SIGMAS, MIN_TOLERANCE = 3.0, 0.05
#: ... and their surface goes as the curve does: cosine of 20°.
MIN_COSINE = 0.94
#: Points that propose a line each, and those that propose a circle by two.
N_LINES, N_CIRCLES = 64, 16
#: A circle has to explain so many times the points of a line, and its radius is within [m].
CIRCLE_GAIN, RADII = 1.25, (1.0, 80.0)
#: Pieces of a patch, at most; what is left is bits.
MAX_PIECES = 40


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of a curve with upright points on it."""

    curve: Curve
    first: float  #: places on the curve where it begins and ends [m]
    last: float
    n_points: int  #: that stand for it, one a voxel
    roughness: float  #: of its patch: σ of its points, not more than twice as wide [m]

    @property
    def length(self) -> float:
        """Length along the curve [m]."""
        return self.last - self.first


def pieces_of(upright: UprightPoints) -> list[Piece]:
    """Divide each patch into straight and round pieces, those with most points first."""
    found: list[Piece] = []
    for begin, end in zip(upright.first[:-1], upright.first[1:], strict=True):
        if end - begin >= MIN_POINTS:
            own = slice(begin, end)
            found += _divided(upright.points[own], upright.normals[own], upright.roughness[own])
    return sorted(found, key=lambda one: (-one.n_points, *one.curve.origin))


def _divided(points: Floats, normals: Floats, roughness: Floats) -> Iterator[Piece]:
    """Yield the pieces of one patch: again and again the curve that most of what is left lies on."""
    xy = np.ascontiguousarray(points[:, :2])
    sigma = float(np.median(roughness))
    tolerance = max(ON_SIGMAS * sigma, MIN_TOLERANCE)
    left = np.arange(len(xy))
    for _ in range(MAX_PIECES):
        if len(left) < MIN_POINTS:
            return
        curve = _best_curve(xy[left], normals[left], tolerance)
        curve, _ = fit_curve(xy[left], curve, tolerance / 2.0)
        is_on, place = _on(curve, xy[left], normals[left], tolerance)
        if np.count_nonzero(is_on) < MIN_POINTS:
            return
        taken = np.flatnonzero(is_on)
        taken = taken[np.argsort(place[taken], kind="stable")]
        ends = np.flatnonzero(np.diff(place[taken]) > MAX_GAP) + 1
        for run in np.split(taken, ends):
            first, last = place[run[0]], place[run[-1]]
            if len(run) >= MIN_POINTS and last - first >= MIN_LENGTH:
                yield Piece(curve, float(first), float(last), len(run), sigma)
        left = np.delete(left, taken)


def _on(curve: Curve, xy: Floats, normals: Floats, tolerance: float) -> tuple[NDArray[np.bool_], Floats]:
    """Tell which points lie on a curve and go as it does, and at which places."""
    place, offset = curve.seen_from(xy)
    is_on = np.abs(offset) <= tolerance
    is_on[is_on] = np.abs((curve.normals_at(place[is_on]) * normals[is_on]).sum(axis=1)) >= MIN_COSINE
    return is_on, place


def _best_curve(xy: Floats, normals: Floats, tolerance: float) -> Curve:
    """Return the line or circle through some of the points and their directions that most points lie on."""
    asked = np.linspace(0, len(xy) - 1, min(len(xy), N_LINES)).astype(np.int64)
    found = np.empty(5)
    _find_best(xy, normals, asked, max(1, len(asked) // N_CIRCLES), tolerance, found)
    return Curve(found[:2].copy(), found[2:4].copy(), float(found[4]))


@kernel
def _find_best(xy, normals, asked, stride, tolerance, found):  # type: ignore[no-untyped-def]
    """Write origin, direction and bend of the best curve to `found`."""
    most, one = -1, np.empty(5)
    for k in asked:
        one[0], one[1], one[2], one[3], one[4] = xy[k, 0], xy[k, 1], normals[k, 1], -normals[k, 0], 0.0
        n_on = _n_on(xy, normals, one, tolerance, most)
        if n_on > most:
            most, found[:] = n_on, one
    if most >= len(xy) / CIRCLE_GAIN:
        return
    most = int(most * CIRCLE_GAIN)
    for a in range(0, len(asked), stride):
        for b in range(a + stride, len(asked), stride):
            if _circle(xy[asked[a]], normals[asked[a]], xy[asked[b]], normals[asked[b]], one):
                n_on = _n_on(xy, normals, one, tolerance, most)
                if n_on > most:
                    most, found[:] = n_on, one


@kernel
def _n_on(xy, normals, curve, tolerance, most):  # type: ignore[no-untyped-def]
    """Count the points on a curve that go as it does; of a curve with no more than `most` only some."""
    x, y, direction_x, direction_y, bend = curve
    side = 1.0 if bend > 0.0 else -1.0
    n_on, n = 0, len(xy)
    for i in range(n):
        away_x, away_y = xy[i, 0] - x, xy[i, 1] - y
        v = away_y * direction_x - away_x * direction_y
        normal_x, normal_y = -direction_y, direction_x
        if bend != 0.0:
            u, inward = away_x * direction_x + away_y * direction_y, 1.0 / abs(bend) - side * v
            far = math.sqrt(u * u + inward * inward)
            v = 1.0 / abs(bend) - far
            along, across = side * u / far, inward / far
            normal_x = -across * direction_y - along * direction_x
            normal_y = across * direction_x - along * direction_y
        if abs(v) <= tolerance and abs(normal_x * normals[i, 0] + normal_y * normals[i, 1]) >= MIN_COSINE:
            n_on += 1
        elif n_on + n - 1 - i <= most:
            return n_on
    return n_on


@kernel
def _circle(a, normal_a, b, normal_b, found):  # type: ignore[no-untyped-def]
    """Write the circle through two points at right angles to their normals to `found`, if there is one."""
    cross = normal_a[0] * normal_b[1] - normal_a[1] * normal_b[0]
    if abs(cross) < 1e-3:
        return False
    reach = ((b[0] - a[0]) * normal_b[1] - (b[1] - a[1]) * normal_b[0]) / cross
    x, y = a[0] + reach * normal_a[0], a[1] + reach * normal_a[1]
    radius_a, radius_b = math.hypot(a[0] - x, a[1] - y), math.hypot(b[0] - x, b[1] - y)
    radius = 0.5 * (radius_a + radius_b)
    if not RADII[0] <= radius <= RADII[1] or abs(radius_a - radius_b) > 0.1 * radius:
        return False
    out_x, out_y = (a[0] - x) / radius_a, (a[1] - y) / radius_a
    found[0], found[1] = x + radius * out_x, y + radius * out_y
    found[2], found[3], found[4] = -out_y, out_x, 1.0 / radius
    return True
