"""
Step edges: straight pieces of borders between planes that do not meet there.

"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.roof_planes.directions import (
    main_directions,
    outline_directions,
    plane_directions,
)
from lidar_buildings.core.roof_topology.borders import Borders
from lidar_buildings.core.roof_topology.result import StepEdge
from lidar_buildings.core.roof_topology.straight_runs import straight_runs

#: Pieces of a line between one pair of planes that are shorter are given to their neighbours [spacings].
_LEAST_PIECE = 1.5
#: Angles tried for what runs in none of the main directions [deg].
_OTHER_ANGLES_DEG = np.arange(0.0, 180.0, 7.5)


def find_steps(
    borders: Borders,
    on_line: NDArray[np.bool_],
    gradients: NDArray[np.float64],
    n_points: NDArray[np.float64],
    rings: tuple[NDArray[np.float64], ...],
    centre: NDArray[np.float64],
    spacing: float,
) -> list[StepEdge]:
    """
    Fit straight segments to the borders where planes do not meet.

    Parameters
    ----------
    borders : Borders
    on_line : ndarray of shape (n_sides,), bool
        Sides that lie on an intersection line already.
    gradients : ndarray of shape (n_planes, 3)
        a, b, c of the planes about the centre.
    n_points : ndarray of shape (n_planes,)
        Points of each plane.
    rings : tuple of ndarray of shape (n, 2)
        The outline's [m].
    centre : ndarray of shape (2 or more,)
        [m].
    spacing : float
        Point spacing [m].

    """
    rows = np.flatnonzero(~on_line)
    if not len(rows):
        return []
    xy, upright = borders.xy[rows], borders.upright[rows]
    angles = _candidate_angles(gradients, n_points * spacing**2, rings)
    free = np.ones(len(rows), dtype=np.bool_)
    first, run = straight_runs(xy, upright, borders.cell, angles, spacing, free)
    others, other_run = straight_runs(xy, upright, borders.cell, np.radians(_OTHER_ANGLES_DEG), spacing, free)
    runs = np.concatenate([first, others])
    run = np.where(other_run >= 0, other_run + len(first), run)
    planes = np.column_stack([borders.first[rows], borders.second[rows]])
    steps: list[StepEdge] = []
    for number in range(len(runs)):
        mine = np.flatnonzero(run == number)
        steps.extend(_edges_of_run(runs[number], xy[mine], planes[mine], gradients, centre, spacing))
    return steps


def _candidate_angles(
    gradients: NDArray[np.float64], area: NDArray[np.float64], rings: tuple[NDArray[np.float64], ...]
) -> NDArray[np.float64]:
    """
    Return the directions of the outline and the planes, and those across them [rad].

    """
    outline, planes = outline_directions(rings), plane_directions(gradients, area)
    angles, weights = (np.concatenate(both) for both in zip(outline, planes, strict=True))
    main = main_directions(angles, weights)
    return np.concatenate([main, main + math.pi / 2])


def _edges_of_run(
    run: NDArray[np.float64],
    xy: NDArray[np.float64],
    planes: NDArray[np.int32],
    gradients: NDArray[np.float64],
    centre: NDArray[np.float64],
    spacing: float,
) -> list[StepEdge]:
    """
    Divide a run among the pairs of planes along it.

    """
    angle, offset, _, _ = run
    along = np.array([math.cos(angle), math.sin(angle)])
    foot = offset * np.array([-along[1], along[0]])
    t = xy @ along
    order = np.argsort(t, kind="stable")
    t, planes = t[order], planes[order]
    key = planes[:, 0].astype(np.int64) << 32 | planes[:, 1]
    edges = []
    for pair in np.unique(key):
        mine = np.flatnonzero(key == pair)
        low, high = float(t[mine[0]]), float(t[mine[-1]])
        if high - low < _LEAST_PIECE * spacing:
            continue
        segment = foot + np.array([[low], [high]]) * along
        i, j = planes[mine[0]]
        rise = [
            float(v) for v in _elevation(gradients[i - 1], segment) - _elevation(gradients[j - 1], segment)
        ]
        if sum(rise) < 0:
            i, j, rise = j, i, [-v for v in rise]
        edges.append(StepEdge(int(i), int(j), segment + centre[:2], (rise[0], rise[1]), high - low))
    return edges


def _elevation(plane: NDArray[np.float64], xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Elevation of a plane above the centre at positions about it [m].

    """
    return np.asarray(xy @ plane[:2] + plane[2])
