"""The partition of an outline into roof faces."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.neighbours.few_rows import rows_by_group
from lidar_buildings.core.stages.building_model.arrangement import Cells, cut_into_cells
from lidar_buildings.core.stages.building_model.cell_costs import cells_of_points, plane_costs, point_weights
from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.core.stages.building_model.faces import face_rings, join_equal_cells, parts_of_one_height
from lidar_buildings.core.stages.building_model.noding import extend_segments
from lidar_buildings.core.stages.building_model.result import RoofFacePatch
from lidar_buildings.core.stages.building_model.simplification import simplified

# Those with which `bench.models.run` divides the virtual roofs into their true faces.
#: Cost of a metre of border between two roof faces, as a misfit over an area [spacings].
_BORDER_COST = 0.15
#: Cost of a corner [m³].
_CORNER_COST = 0.15
#: Walls of a re-entrant corner run on into the roof where they turn by more than this [rad].
_REENTRANT = 0.35


def partition_outline(
    outline: Outline,
    points: FloatArray,
    planes: FloatArray,
    lines: tuple[FloatArray, FloatArray],
    spacing: float,
    config: BuildingModelConfig,
) -> list[RoofFacePatch]:
    """
    Divide an outline, valid and on the output grid, into roof faces.

    Ridges, hips, valleys and steps, run on to the next line, cut the outline into cells; every cell gets the
    plane that fits the points best at the least length of borders and number of corners; cells of one plane
    are joined. `lines` are first steps and then lines in which planes meet, in plan.
    """
    cuts = lines[0][:0]
    if len(planes) > 1:
        segments = np.concatenate([*lines, *map(_reentrant_walls, outline.rings)])
        cuts = extend_segments(segments, ring_walls(outline.rings), len(lines[0]))
    cells = cut_into_cells(outline, cuts)
    cell = cells_of_points(cells, points)
    weights = point_weights(points, outline.exterior, spacing)
    costs = plane_costs(points, weights, cell, cells, planes, spacing)
    prices = _BORDER_COST * spacing, _CORNER_COST
    labels = simplified(cells, np.argmin(costs, axis=1), costs, planes, prices, config.min_face_area)
    return _faces(cells, labels, cell, planes, config.min_part_step)


def _faces(
    cells: Cells, labels: IntArray, cell: IntArray, planes: FloatArray, min_part_step: float
) -> list[RoofFacePatch]:
    """Join the cells of one plane."""
    face = join_equal_cells(cells, labels)
    rings = face_rings(cells, face)
    own = np.empty((len(rings), 3))
    own[face] = planes[labels]
    part = parts_of_one_height(cells, face, own, min_part_step).tolist()
    rows = _rows_by_face(face, cell, len(rings))
    return [RoofFacePatch(*each) for each in zip(rings, own, rows, part, strict=True) if each[0]]


def _reentrant_walls(ring: FloatArray) -> FloatArray:
    """Return short segments that lead from re-entrant corners along their walls into the building."""
    ends = ring_walls([ring])
    out = ends[:, 1] - ends[:, 0]
    into = np.concatenate([out[-1:], out[:-1]])
    left = into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0]
    if left.min() >= 0.0:
        return ends[:0]
    corner = np.arctan2(left, np.sum(into * out, axis=1)) < -_REENTRANT
    at, a, b = ring[corner], into[corner], out[corner]
    steps = np.concatenate([a / np.linalg.norm(a, axis=1)[:, None], -b / np.linalg.norm(b, axis=1)[:, None]])
    starts = np.concatenate([at, at])
    return np.stack([starts, starts + 0.01 * steps], axis=1)


def _rows_by_face(face: IntArray, cell: IntArray, n_faces: int) -> list[IntArray]:
    rows, first = rows_by_group(1 + np.append(face, -1)[cell], n_faces + 1)
    return [rows[begin:end] for begin, end in pairwise(first[1:].tolist())]
