"""Corners of steps, moved onto the ridges and hips that end at them: eaves above a lower roof."""

from __future__ import annotations

import math
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.stages.roof_topology.step_lines import StepLines, line_ends

#: Ends of two lines that are nearer than so many spacings to the end of a ridge may be a corner that it ends
#: in; the corner then moves by no more than so many.
_REACH, _MOST_MOVE = 2.5, 0.5
#: Lines that meet under a smaller angle than that of this sine have no corner.
_LEAST_SINE = 0.5


class _Corner(NamedTuple):
    """A corner of two lines, how far it is from a ridge [m], and a place and the normal of that."""

    distance: float
    lines: tuple[int, int]
    place: FloatArray
    normal: FloatArray


def onto_ridges(
    steps: StepLines, is_bound: NDArray[np.bool_], ridges: FloatArray, spacing: float
) -> StepLines:
    """
    Move lines across themselves, as little as need be, so that ridges and hips end in their corners.

    Planes are known to centimetres where they meet, steps to a part of a spacing. Each line moves once, for
    the nearest ridge.

    Parameters
    ----------
    steps : StepLines
    is_bound : ndarray of bool, shape (n_lines,)
        Lines that stay where they are.
    ridges : ndarray of shape (n, 2, 2)
        Ends of the pieces of intersection lines about the centre [m].
    spacing : float
        Point spacing [m].
    """
    if len(steps.angle) < 2 or not len(ridges):
        return steps
    normals = np.column_stack([-np.sin(steps.angle), np.cos(steps.angle)])
    offset, is_free = steps.offset.copy(), ~is_bound
    for _, lines, place, normal in sorted(_corners(steps, normals, ridges, spacing), key=lambda one: one[:2]):
        pair = list(lines)
        (ax, ay), (bx, by) = normals[pair].tolist()
        sine = ax * by - ay * bx
        # A line that moves by 1 moves the corner by so much across the ridge.
        rates = np.array([by * normal[0] - bx * normal[1], ax * normal[1] - ay * normal[0]]) / sine
        rates *= is_free[pair]
        if not rates.any():
            continue
        x, y = _meeting(normals, offset, lines)
        moves = rates * ((place - (x, y)) @ normal / (rates @ rates))
        if np.abs(moves).max() <= _MOST_MOVE * spacing:
            offset[pair] += moves
            is_free[pair] = False
    return steps._replace(offset=offset)


def _corners(steps: StepLines, normals: FloatArray, ridges: FloatArray, spacing: float) -> list[_Corner]:
    """Return the corners that lie beside a ridge's line near its end."""
    along = ridges[:, 1] - ridges[:, 0]
    length = np.hypot(*along.T)
    ends = ridges[length > 0.0].reshape(-1, 2)
    across = np.repeat(np.column_stack([-along[:, 1], along[:, 0]])[length > 0.0], 2, axis=0)
    across /= np.repeat(length[length > 0.0], 2)[:, None]
    n, places = len(steps.angle), line_ends(steps).reshape(-1, 2)
    has_place = np.flatnonzero(np.isfinite(places[:, 0]))
    near = cKDTree(places[has_place]).query_ball_point(ends, _REACH * spacing)
    found = []
    for k, at in enumerate(near):
        for pair in combinations(sorted(set((has_place[at] % n).tolist())), 2):
            x, y = _meeting(normals, steps.offset, pair) - ends[k]
            if math.hypot(x, y) > _REACH * spacing:
                continue
            distance = abs(float(x * across[k, 0] + y * across[k, 1]))
            if distance <= _MOST_MOVE * spacing:
                found.append(_Corner(distance, pair, ends[k], across[k]))
    return found


def _meeting(normals: FloatArray, offset: FloatArray, lines: tuple[int, int]) -> FloatArray:
    """Return where two lines meet, infinitely far off where they are nearly parallel."""
    (ax, ay), (bx, by) = normals[list(lines)].tolist()
    one, other = offset[list(lines)].tolist()
    sine = ax * by - ay * bx
    if abs(sine) < _LEAST_SINE:
        return np.full(2, np.inf)
    return np.array([one * by - other * ay, ax * other - bx * one]) / sine
