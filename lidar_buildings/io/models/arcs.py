"""Arcs in rings that are drawn with chords: found again, for drawings that know arcs."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

#: Chords that turn by more are walls of a polygon: an octagon turns by 45° [deg].
_WIDEST_TURN = 44.0
#: How many times its coordinates' rounding a chord's length, or a vertex's distance from the arc, may differ:
#: both ends of a chord are rounded in x and y, and neighbours are compared.
_TOLERANCE = 4.0
#: A half circle whose rounded chords turn by this share more is still one;
#: wide margin: chords are metres, rounding millimetres.
_OVER = 1e-2
#: An arc that leaves its chord by fewer roundings than this is a straight line; wide margin above
#: `_TOLERANCE`.
_LEAST_BULGE = 20.0


class ArcRing(NamedTuple):
    """A ring of straight and curved segments."""

    #: The ring's vertices at which a segment begins, ascending; it ends where the next one begins. Shape
    #: (n_segments,).
    rows: NDArray[np.int64]
    #: Tangent of a quarter of the angle that the segment sweeps, as drawings have it: 0 for straight ones,
    #: positive where the arc turns left, at most about 1 (half a circle), shape (n_segments,).
    bulges: NDArray[np.float64]


def ring_arcs(ring: NDArray[np.float64]) -> ArcRing:
    """
    Find the arcs in an open ring [m].

    Consecutive edges of one length that turn by one angle are the chords of an arc: regularised outlines draw
    theirs so. What differs by more than rounding to float32, which messages carry, is left as it is, and so
    are polygons with few sides.
    """
    n = len(ring)
    precision = float(np.spacing(np.float32(np.abs(ring).max(initial=1.0))))
    bulges = np.zeros(n)
    kept = np.ones(n, dtype=bool)
    for first, n_chords, turn in _runs(ring, _TOLERANCE * precision):
        for start, chords in _halves(first, n_chords, turn):
            rows = np.arange(start, start + chords + 1) % n
            bulge = math.tan(chords * turn / 4.0)
            if _is_arc(ring[rows], bulge, precision):
                bulges[rows[0]] = bulge
                kept[rows[1:-1]] = False
    rows = np.flatnonzero(kept)
    return ArcRing(rows, bulges[rows])


def _runs(ring: NDArray[np.float64], tolerance: float) -> list[tuple[int, int, float]]:
    """Return (first vertex, chords, turn [rad]) of every run of two or more equal chords and turns."""
    n = len(ring)
    if n < 4:
        return []
    step = np.roll(ring, -1, axis=0) - ring
    length = np.hypot(*step.T)
    turn = _turns(step)
    equal = np.abs(length - np.roll(length, 1)) <= tolerance
    widest = math.radians(_WIDEST_TURN)
    bend = equal & (np.abs(turn) * length > tolerance) & (np.abs(turn) < widest)
    if not bend.any():
        return []
    # joint k goes on to joint k + 1: the edge between them turns by the same angle at both of its ends
    goes_on = bend & np.roll(bend, -1) & (np.abs(turn - np.roll(turn, -1)) * length <= 2.0 * tolerance)
    if goes_on.all():
        return [(0, n, float(turn.mean()))]
    starts = np.flatnonzero(bend & ~np.roll(goes_on, 1))
    return [_run(turn, goes_on, int(joint)) for joint in starts]


def _turns(step: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angle by which a ring turns at each vertex, −π to π, positive to the left [rad]."""
    before = np.roll(step, 1, axis=0)
    cross = before[:, 0] * step[:, 1] - before[:, 1] * step[:, 0]
    return np.asarray(np.arctan2(cross, np.einsum("ij,ij->i", before, step)))


def _run(turn: NDArray[np.float64], goes_on: NDArray[np.bool_], joint: int) -> tuple[int, int, float]:
    n = len(turn)
    joints = [joint]
    while goes_on[joints[-1]]:
        joints.append((joints[-1] + 1) % n)
    return (joint - 1) % n, len(joints) + 1, float(turn[joints].mean())


def _halves(first: int, n_chords: int, turn: float) -> list[tuple[int, int]]:
    """Divide a run into (first vertex, chords) of at most half a circle each."""
    n_parts = max(math.ceil(n_chords * abs(turn) / math.pi - _OVER), 1)
    ends = [first + n_chords * k // n_parts for k in range(n_parts + 1)]
    return [(start, end - start) for start, end in pairwise(ends)]


def _is_arc(vertices: NDArray[np.float64], bulge: float, precision: float) -> bool:
    """Whether vertices lie on the arc between the first and the last of them."""
    chord = vertices[-1] - vertices[0]
    width = float(np.hypot(*chord))
    if 0.5 * abs(bulge) * width < _LEAST_BULGE * precision:
        return False
    # from the chord's middle to the centre, as a multiple of the chord turned left
    centre = 0.5 * (vertices[0] + vertices[-1])
    centre = centre + np.array([-chord[1], chord[0]]) * (1.0 / bulge - bulge) / 4.0
    radius = 0.25 * width * (abs(bulge) + 1.0 / abs(bulge))
    off = np.abs(np.hypot(*(vertices - centre).T) - radius)
    return bool(off.max() <= _TOLERANCE * precision)
