"""Corners: where two found walls meet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]

#: Ends of walls are drawn to a corner that lies within this of both [m].
REACH = 0.5
#: Walls that meet at a flatter angle have no corner of their own: sine of 15°.
MIN_SINE = 0.26


def join_corners(lines: Sequence[Floats]) -> list[Floats]:
    """Return polylines, shape (n ≥ 2, 2) each, whose ends are drawn to where they meet others' ends."""
    joined = [line.copy() for line in lines]
    ends = [(k, at) for k in range(len(lines)) for at in (0, -1)]
    if len(ends) < 4:
        return joined
    places = np.array([lines[k][at] for k, at in ends])
    pairs = cKDTree(places).query_pairs(2.0 * REACH, output_type="ndarray")
    corners = []
    for i, j in pairs.tolist():
        (one, at), (other, there) = ends[i], ends[j]
        if one != other:
            corner = _corner(lines[one], at, lines[other], there)
            if corner is not None:
                reach = max(np.hypot(*(corner - places[i])), np.hypot(*(corner - places[j])))
                if reach <= REACH:
                    corners.append((float(reach), i, j, corner))
    taken: set[int] = set()
    for _, i, j, corner in sorted(corners, key=lambda one: one[:3]):
        if not taken & {i, j}:
            taken |= {i, j}
            for k, at in (ends[i], ends[j]):
                joined[k][at] = corner
    return joined


def _corner(one: Floats, at: int, other: Floats, there: int) -> Floats | None:
    """Return where the lines of two ends meet, None if they hardly do."""
    (a, p), (b, q) = _ray(one, at), _ray(other, there)
    sine = p[0] * q[1] - p[1] * q[0]
    if abs(sine) < MIN_SINE:
        return None
    away = b - a
    return a + (away[0] * q[1] - away[1] * q[0]) / sine * p


def _ray(line: Floats, at: int) -> tuple[Floats, Floats]:
    """Return an end and the direction in which the line leaves it."""
    out = line[at] - line[1 if at == 0 else -2]
    return line[at], out / np.hypot(*out)


def touching(lines: Sequence[Floats], reach: float) -> NDArray[np.bool_]:
    """Tell which lines have an end within reach of another line's end [m]."""
    is_touching = np.zeros(len(lines), dtype=bool)
    ends = np.array([line[at] for line in lines for at in (0, -1)]).reshape(-1, 2)
    for i, j in cKDTree(ends).query_pairs(reach, output_type="ndarray").tolist() if len(ends) else ():
        if i // 2 != j // 2:
            is_touching[[i // 2, j // 2]] = True
    return is_touching
