"""Straight lines through the sides of steps: the best division of each chain of them, as of outlines."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.surfaces.ring_division import divide_chain, normal_angle, running_sums, scatter_of

#: Scatter of sides across their line [spacings], what a line must save in squared offsets over noise², and
#: one in a direction of its own beside that; of a chain whose every `_SAMPLE` spacings count once. They are
#: those of the walls of outlines: a step is a wall of the upper roof.
_NOISE, _LINE, _OWN_DIRECTION, _SAMPLE = 0.3, 20.0, 15.0, 1.98


def straight_runs(
    xy: FloatArray,
    chains: tuple[IntArray, IntArray, BoolArray],
    angles: FloatArray,
    cell: float,
    spacing: float,
) -> tuple[FloatArray, IntArray]:
    """
    Divide chains of sides into straight runs, in the best of all ways for what lines cost.

    Parameters
    ----------
    xy : ndarray of shape (n_sides, 2)
        Middles of the sides, near the origin [m].
    chains : tuple
        As `step_chains` returns them.
    angles : ndarray of shape (n_angles,)
        Directions that lines may have for nothing [rad].
    cell : float
        Length of a side [m].
    spacing : float
        Point spacing [m].

    Returns
    -------
    runs : ndarray of shape (n_runs, 2)
        Angle [rad] and offset from the origin to the left of that direction [m].
    run : ndarray of shape (n_sides,), int64
        Which run each side lies on.
    """
    return _runs(xy, *chains, angles, cell / (_SAMPLE * spacing), _NOISE * spacing)


@kernel
def _runs(xy, order, begin, is_closed, angles, weight, noise):  # type: ignore[no-untyped-def]
    runs, run, n_runs = np.empty((len(xy), 2)), np.empty(len(xy), np.int64), 0
    # Normals of the lines.
    cosines, sines = np.empty(len(angles)), np.empty(len(angles))
    for k in range(len(angles)):
        cosines[k], sines[k] = -math.sin(angles[k]), math.cos(angles[k])
    for chain in range(len(is_closed)):
        rows = order[begin[chain] : begin[chain + 1]]
        n, shift = (len(rows) + 1) // 2, 0
        spots, weights = np.empty((n, 2)), np.full(n, 2.0 * weight)
        for k in range(n):
            one, other = rows[2 * k], rows[min(2 * k + 1, len(rows) - 1)]
            spots[k, 0], spots[k, 1] = 0.5 * (xy[one, 0] + xy[other, 0]), 0.5 * (xy[one, 1] + xy[other, 1])
        if len(rows) % 2 == 1:
            weights[n - 1] = weight
        sums = running_sums(spots, weights)
        first, kind = _divided(sums, n, 0, cosines, sines, noise)
        if is_closed[chain]:
            # Once more from a corner, the farthest from where the first division began.
            corner = first[0]
            for side in first:
                if abs(side - n / 2) < abs(corner - n / 2):
                    corner = side
            shift = corner % n
            first, kind = _divided(sums, n, shift, cosines, sines, noise)
        end = n
        for wall in range(len(first)):
            _, x, y, xx, xy_, yy = scatter_of(sums, shift + first[wall], shift + end)
            angle = angles[kind[wall]] if kind[wall] >= 0 else normal_angle(xx, xy_, yy) - 0.5 * math.pi
            runs[n_runs, 0], runs[n_runs, 1] = angle, y * math.cos(angle) - x * math.sin(angle)
            for k in range(first[wall], end):
                for row in rows[2 * ((shift + k) % n) : 2 * ((shift + k) % n) + 2]:
                    run[row] = n_runs
            end = first[wall]
            n_runs += 1
    return runs[:n_runs], run


@kernel
def _divided(sums, n, shift, cosines, sines, noise):  # type: ignore[no-untyped-def]
    """Return first side and kind of each line, last to first; steps are as in outlines, without arcs."""
    first, kind, _ = divide_chain(
        sums, n, shift, 1.0, cosines, sines, noise, _LINE, _OWN_DIRECTION, _LINE, np.inf, 0.0, False
    )
    return first, kind
