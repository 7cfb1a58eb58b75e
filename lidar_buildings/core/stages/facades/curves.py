"""Curves in plan that walls stand on, straight lines and arcs of circles, and their robust fit to points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Tukey's biweight leaves points out that lie farther off than this [σ] (Huber 1981).
TUKEY = 4.685
#: The median of what is normally distributed, without sign, lies at so many σ.
MEDIAN_TO_SIGMA = 1.4826
#: Rounds of the fit; weights settle in half of them.
ROUNDS = 8
#: The σ of a fit is not taken for less [m]: of two points.
LEAST_SIGMA = 0.003
#: Rise of a circle over its chords [m].
MAX_SAGITTA = 0.01


@dataclass(frozen=True, eq=False)
class Curve:
    """
    A straight line, or a circle of which an arc is meant.

    Places on it count from `origin` in its direction [m]; offsets from it are positive on its left [m].
    """

    origin: Floats  #: a place on it, shape (2,) [m]
    direction: Floats  #: unit vector there, shape (2,)
    bend: float = 0.0  #: 1/radius, positive where it turns to the left [1/m]

    @property
    def normal(self) -> Floats:
        """Unit vector to the left at the origin."""
        return np.array([-self.direction[1], self.direction[0]])

    @property
    def centre(self) -> Floats:
        """Centre of the circle."""
        return self.origin + self.normal / self.bend

    def seen_from(self, xy: Floats) -> tuple[Floats, Floats]:
        """Return place along and offset of positions (n, 2)."""
        away = xy - self.origin
        u, v = away @ self.direction, away @ self.normal
        if self.bend == 0.0:
            return u, v
        radius = 1.0 / abs(self.bend)
        side = np.sign(self.bend)
        angle = np.arctan2(u, radius - side * v)
        return radius * angle, side * (radius - np.hypot(u, radius - side * v))

    def at(self, place: Floats) -> Floats:
        """Return the positions of places on the curve, shape (n, 2)."""
        if self.bend == 0.0:
            return self.origin + place[:, None] * self.direction
        angle = place * self.bend
        u, v = np.sin(angle) / self.bend, (1.0 - np.cos(angle)) / self.bend
        return self.origin + u[:, None] * self.direction + v[:, None] * self.normal

    def normals_at(self, place: Floats) -> Floats:
        """Return unit vectors to the left of the curve at some places, shape (n, 2)."""
        angle = place * self.bend
        return np.cos(angle)[:, None] * self.normal - np.sin(angle)[:, None] * self.direction

    @property
    def half_length(self) -> float:
        """How far it reaches from its origin, either way [m]."""
        return np.pi / abs(self.bend) if self.bend else np.inf

    def chords(self, first: float, last: float) -> Floats:
        """Return the vertices of a polyline along the curve between two places, shape (n ≥ 2, 2)."""
        n = 1
        if self.bend != 0.0:
            longest = np.sqrt(8.0 * MAX_SAGITTA / abs(self.bend))
            n = max(1, int(np.ceil((last - first) / longest)))
        return self.at(np.linspace(first, last, n + 1))

    def begun_at(self, place: float) -> Curve:
        """Return the curve with its origin at a place on it."""
        where = np.array([place])
        normal = self.normals_at(where)[0]
        return Curve(self.at(where)[0], np.array([normal[1], -normal[0]]), self.bend)

    def reversed(self) -> Curve:
        """Return the curve run through the other way."""
        return replace(self, direction=-self.direction, bend=-self.bend)


def line_through(xy: Floats, weights: Floats) -> Curve:
    """Return the line of least weighted squares of distances (total least squares); ≥ 2 positions."""
    middle = weights @ xy / weights.sum()
    away = xy - middle
    moments = (away * weights[:, None]).T @ away
    angle = 0.5 * np.arctan2(2.0 * moments[0, 1], moments[0, 0] - moments[1, 1])
    return Curve(middle, np.array([np.cos(angle), np.sin(angle)]))


def circle_through(xy: Floats, weights: Floats, about: Curve) -> Curve:
    """
    Return the circle of least weighted squares near an arc: one step of Gauss and Newton from it.

    Parameters are the arc's offset, turn and bend at the weighted middle, so that flat arcs are as well
    conditioned as round ones.
    """
    place, offset = about.seen_from(xy)
    middle = float(weights @ place / weights.sum())
    u = place - middle
    # Offset of a curve that is moved, turned and bent a little more: a + b·u + c·u²/2.
    terms = np.column_stack([np.ones(len(u)), u, 0.5 * u * u])
    root = np.sqrt(weights)[:, None]
    move, turn, bend = np.linalg.lstsq(terms * root, offset * root[:, 0], rcond=None)[0]
    at = about.begun_at(middle)
    angle = np.arctan2(at.direction[1], at.direction[0]) + np.arctan(turn)
    return Curve(
        at.origin + move * at.normal, np.array([np.cos(angle), np.sin(angle)]), float(about.bend + bend)
    )


def fit_curve(xy: Floats, start: Curve, noise: float, weights: Floats | None = None) -> tuple[Curve, float]:
    """
    Fit a curve of the same kind to positions of which some lie elsewhere; return it and the points' σ [m].

    Weights fall with the distance by Tukey's biweight, whose width follows the median distance of what is
    within it at first, `noise` [m] at the beginning.
    """
    curve, sigma = start, noise
    given = np.ones(len(xy)) if weights is None else weights
    offset = curve.seen_from(xy)[1]
    for _ in range(ROUNDS):
        share = np.clip(1.0 - (offset / (TUKEY * sigma)) ** 2, 0.0, None)
        own = given * share * share
        if np.count_nonzero(own) < 4:
            return curve, sigma
        curve = circle_through(xy, own, curve) if start.bend else line_through(xy, own)
        offset = curve.seen_from(xy)[1]
        near = np.abs(offset)
        near = near[near < TUKEY * sigma]
        if len(near):
            # cut off at Tukey's limit, so it can shrink but hardly grow
            sigma = min(max(MEDIAN_TO_SIGMA * float(np.median(near)), LEAST_SIGMA), noise)
    if curve.direction @ start.direction < 0.0:
        curve = curve.reversed()
    return curve, sigma
