"""Corners of steps, moved onto the ridges and hips that end at them: eaves above a lower roof."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
        # a line that moves by 1 moves the corner by so much across the ridge
        rates = np.linalg.solve(normals[pair].T, normal) * is_free[pair]
        if not rates.any():
            continue
        corner = np.linalg.solve(normals[pair], offset[pair])
        moves = rates * ((place - corner) @ normal / (rates @ rates))
        if np.abs(moves).max() <= _MOST_MOVE * spacing:
            offset[pair] += moves
            is_free[pair] = False
    return steps._replace(offset=offset)


def _corners(steps: StepLines, normals: FloatArray, ridges: FloatArray, spacing: float) -> list[_Corner]:
    """Return the corners that lie beside a ridge's line near its end."""
    places = line_ends(steps)
    found = []
    for ridge in ridges:
        along = ridge[1] - ridge[0]
        length = np.hypot(*along)
        if length == 0.0:
            continue
        normal = np.array([-along[1], along[0]]) / length
        for end in ridge:
            is_near = np.hypot(*(places - end).T).min(axis=1) <= _REACH * spacing
            for pair in combinations(np.flatnonzero(is_near).tolist(), 2):
                both = normals[list(pair)]
                if abs(both[0, 0] * both[1, 1] - both[0, 1] * both[1, 0]) < _LEAST_SINE:
                    continue
                corner = np.linalg.solve(both, steps.offset[list(pair)])
                distance = abs(float((corner - end) @ normal))
                if distance <= _MOST_MOVE * spacing and np.hypot(*(corner - end)) <= _REACH * spacing:
                    found.append(_Corner(distance, pair, end, normal))
    return found
