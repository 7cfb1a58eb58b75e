"""Pieces of straight lines and arcs in patches of upright points: where walls may stand, and how far."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

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
    asked = np.linspace(0, len(xy) - 1, min(len(xy), N_LINES)).astype(np.intp)
    lines = [Curve(xy[k], np.array([normals[k, 1], -normals[k, 0]])) for k in asked]
    counts = [int(np.count_nonzero(_on(one, xy, normals, tolerance)[0])) for one in lines]
    best, most = lines[int(np.argmax(counts))], max(counts)
    if most >= len(xy) / CIRCLE_GAIN:
        return best
    most = int(most * CIRCLE_GAIN)
    for i, k in combinations(asked[:: max(1, len(asked) // N_CIRCLES)], 2):
        circle = _circle(xy[i], normals[i], xy[k], normals[k])
        if circle is not None:
            n_on = int(np.count_nonzero(_on(circle, xy, normals, tolerance)[0]))
            if n_on > most:
                best, most = circle, n_on
    return best


def _circle(a: Floats, normal_a: Floats, b: Floats, normal_b: Floats) -> Curve | None:
    """Return the circle through two points at right angles to their normals, None if there is none."""
    cross = normal_a[0] * normal_b[1] - normal_a[1] * normal_b[0]
    if abs(cross) < 1e-3:
        return None
    away = b - a
    centre = a + (away[0] * normal_b[1] - away[1] * normal_b[0]) / cross * normal_a
    radii = np.hypot(*(a - centre)), np.hypot(*(b - centre))
    radius = 0.5 * (radii[0] + radii[1])
    if not RADII[0] <= radius <= RADII[1] or abs(radii[0] - radii[1]) > 0.1 * radius:
        return None
    out = (a - centre) / radii[0]
    return Curve(centre + radius * out, np.array([-out[1], out[0]]), float(1.0 / radius))
