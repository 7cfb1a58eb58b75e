"""Step edges: straight pieces of borders between planes that do not meet there."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.stages.roof_topology.borders import Borders
from lidar_buildings.core.stages.roof_topology.step_chains import step_chains
from lidar_buildings.core.stages.roof_topology.step_lines import StepLines
from lidar_buildings.core.stages.roof_topology.straight_runs import straight_runs
from lidar_buildings.core.surfaces.roof_planes.directions import (
    main_directions,
    plane_directions,
    wall_directions,
)

#: Shorter pieces of a line between one pair of planes are left out [spacings].
_LEAST_PIECE = 2.0
#: Points keep so far from a border in the mean [spacings].
_USUAL_GAP = 0.5


def find_step_lines(
    borders: Borders,
    on_line: BoolArray,
    points: FloatArray,
    gradients: FloatArray,
    area: FloatArray,
    walls: FloatArray,
    centre: FloatArray,
    spacing: float,
) -> StepLines:
    """
    Fit straight lines to the borders where planes do not meet.

    Sides `on_line` lie on an intersection line already. The planes are about the centre; `area` is how large
    each is in plan, `spacing` the points' or more if edges are to be straighter [m].
    """
    rows = np.flatnonzero(~on_line)
    if not len(rows):
        none, line, planes = np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros((0, 2), dtype=np.int32)
        return StepLines(none, none, line, np.zeros((0, 2)), planes, none, none)
    xy = borders.xy[rows]
    first, second = borders.first[rows], borders.second[rows]
    tops, others = (_elevations(gradients[planes - 1], xy) for planes in (first, second))
    higher = tops >= others
    upper = np.where(higher, first, second)
    chains = step_chains(xy, borders.upright[rows], upper, np.maximum(tops, others), borders.cell)
    runs, run = straight_runs(xy, chains, _candidate_angles(gradients, area, walls), borders.cell, spacing)
    angle, offset = runs[run, 0], runs[run, 1]
    t = xy[:, 0] * np.cos(angle) + xy[:, 1] * np.sin(angle)
    beside = _upper_points(borders, rows, points, centre, angle, offset, higher)
    weight = np.bincount(run, minlength=len(runs))
    mean = np.bincount(run, beside, len(runs)) / np.maximum(weight, 1)
    planes = np.column_stack([upper, first + second - upper])
    line, ends, planes, length = _pieces(run, t, planes, borders.cell, spacing)
    gap = np.maximum(np.abs(mean), _USUAL_GAP * spacing)
    return StepLines(runs[:, 0], runs[:, 1], line, ends, planes, length, gap)


def _elevations(gradients: FloatArray, xy: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ki,ki->k", gradients[:, :2], xy) + gradients[:, 2])


def _candidate_angles(gradients: FloatArray, area: FloatArray, walls: FloatArray) -> FloatArray:
    """Return the directions of the outline and the planes, and those across them [rad]."""
    outline, planes = wall_directions(walls), plane_directions(gradients, area)
    angles, weights = (np.concatenate(both) for both in zip(outline, planes, strict=True))
    main = main_directions(angles, weights)
    return np.concatenate([main, main + math.pi / 2])


def _upper_points(
    borders: Borders,
    rows: IntArray,
    points: FloatArray,
    centre: FloatArray,
    angle: FloatArray,
    offset: FloatArray,
    higher: BoolArray,
) -> FloatArray:
    """Return how far the upper roof's nearest points lie to the left of each side's line [m]."""
    near = np.where(higher, borders.near_first[rows], borders.near_second[rows])
    away = points[near, :2] - centre[:2]
    return np.asarray(away[:, 1] * np.cos(angle) - away[:, 0] * np.sin(angle) - offset)


def _pieces(
    run: IntArray, t: FloatArray, planes: NDArray[np.int32], cell: float, spacing: float
) -> tuple[IntArray, FloatArray, NDArray[np.int32], FloatArray]:
    """Divide runs where the pair of planes changes: return run, ends, planes and length of every piece."""
    order = np.lexsort((t, planes[:, 1], planes[:, 0], run))
    run, t, planes = run[order], t[order], planes[order]
    if not len(run):
        return run, np.zeros((0, 2)), planes, t
    new = (run[1:] != run[:-1]) | np.any(planes[1:] != planes[:-1], axis=1)
    begin = np.concatenate([[0], np.flatnonzero(new) + 1])
    end = np.concatenate([begin[1:], [len(run)]]) - 1
    ends = np.column_stack([t[begin] - 0.5 * cell, t[end] + 0.5 * cell])
    length = ends[:, 1] - ends[:, 0]
    kept = length >= _LEAST_PIECE * spacing
    line, ends, planes = run[begin][kept], ends[kept], planes[begin][kept]
    return line, ends, planes, length[kept]
