"""The partition of an outline into roof faces."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.neighbours.few_rows import rows_by_number
from lidar_buildings.core.stages.building_model.arrangement import Cells, cut_into_cells, walls_of
from lidar_buildings.core.stages.building_model.cell_costs import cells_of_points, plane_costs
from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.core.stages.building_model.faces import (
    face_rings,
    join_equal_cells,
)
from lidar_buildings.core.stages.building_model.heights import Limits
from lidar_buildings.core.stages.building_model.missed_parts import find_missed_parts
from lidar_buildings.core.stages.building_model.noding import extend_segments
from lidar_buildings.core.stages.building_model.roof_face import RoofFacePatch
from lidar_buildings.core.stages.building_model.samples import Samples, make_samples
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
    plane_id: NDArray[np.uint16],
    planes: FloatArray,
    lines: tuple[FloatArray, FloatArray],
    spacing: float,
    config: BuildingModelConfig,
) -> list[RoofFacePatch]:
    """
    Divide an outline into roof faces.

    Ridges, hips, valleys and steps, run on to the next line, cut the outline into cells; every cell gets the
    plane that fits the points best at the least length of borders and number of corners; cells of one plane
    are joined.

    Parameters
    ----------
    outline : Outline
        Valid, on the output grid [m].
    points : ndarray of shape (n_points, 3)
        Roof points [m].
    plane_id : ndarray of shape (n_points,)
        Number of each point's plane, 0 = none.
    planes : ndarray of shape (n_planes, 3)
        z = a·x + b·y + c of plane k in row k − 1; at least one.
    lines : tuple of ndarray of shape (n_lines, 2, 2)
        Candidate borders in plan, first steps and then lines in which planes meet [m].
    spacing : float
        Point spacing [m].
    config : BuildingModelConfig
    """
    samples = make_samples(points, plane_id, outline, spacing)
    inward = np.concatenate([_reentrant_walls(ring) for ring in outline.rings])
    segments = np.concatenate([*lines, inward])
    roof = _Roof(outline, points, samples, len(lines[0]), Limits.of(points, spacing), planes, spacing, config)
    found = _label(roof, segments)
    missed = find_missed_parts(points, plane_id, found.above(roof), outline, spacing, config.min_face_area)
    if len(missed.sides):
        segments = np.concatenate([segments, missed.sides])
        roof = replace(roof, planes=np.concatenate([roof.planes, missed.planes]))
        found = _label(roof, segments)
    return _faces(roof, found)


@dataclass(frozen=True, eq=False)
class _Roof:
    """What every attempt at a partition starts from."""

    outline: Outline
    points: FloatArray
    samples: Samples
    n_steps: int
    limits: Limits
    planes: FloatArray
    spacing: float
    config: BuildingModelConfig


@dataclass(frozen=True, eq=False)
class _Labelled:
    """Cells with the row of each one's plane, and the cell of every point, -1 beside the outline."""

    cells: Cells
    labels: IntArray
    cell: IntArray

    def above(self, roof: _Roof) -> FloatArray:
        """Return every point's height above its face, 0 for points beside the outline [m]."""
        plane = roof.planes[self.labels[self.cell]]
        above = roof.points[:, 2] - np.einsum("ij,ij->i", plane[:, :2], roof.points[:, :2]) - plane[:, 2]
        return np.where(self.cell >= 0, above, 0.0)


def _label(roof: _Roof, segments: FloatArray) -> _Labelled:
    """Cut the outline along segments, steps first; give every cell a plane."""
    outline, planes, config = roof.outline, roof.planes, roof.config
    lines = extend_segments(segments, walls_of(outline), roof.n_steps) if len(planes) > 1 else segments[:0]
    cells = cut_into_cells(outline, lines)
    cell = cells_of_points(cells, roof.samples.points)
    costs = plane_costs(roof.samples, cell, cells, planes, roof.limits)
    labels = np.argmin(costs, axis=1)
    prices = _BORDER_COST * roof.spacing, _CORNER_COST
    labels = simplified(cells, labels, costs, planes, prices, config.min_face_area)
    return _Labelled(cells, labels, cell[: len(roof.points)])


def _faces(roof: _Roof, found: _Labelled) -> list[RoofFacePatch]:
    face = join_equal_cells(found.cells, found.labels)
    rings = face_rings(found.cells, face)
    first = np.unique(face, return_index=True)[1]
    rows = _rows_by_face(face, found.cell, len(rings))
    return [
        RoofFacePatch(rings[k], roof.planes[found.labels[first[k]]], rows[k])
        for k in range(len(rings))
        if rings[k]
    ]


def _reentrant_walls(ring: FloatArray) -> FloatArray:
    """Return short segments that lead from re-entrant corners along their walls into the building."""
    ends = ring_walls([ring])
    out = ends[:, 1] - ends[:, 0]
    into = np.concatenate([out[-1:], out[:-1]])
    turn = np.arctan2(into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0], np.sum(into * out, axis=1))
    corner = turn < -_REENTRANT
    if not corner.any():
        return ends[:0]
    at, a, b = ring[corner], into[corner], out[corner]
    steps = np.concatenate([a / np.linalg.norm(a, axis=1)[:, None], -b / np.linalg.norm(b, axis=1)[:, None]])
    starts = np.concatenate([at, at])
    return np.stack([starts, starts + 0.01 * steps], axis=1)


def _rows_by_face(face: IntArray, cell: IntArray, n_faces: int) -> list[IntArray]:
    rows = np.flatnonzero(cell >= 0)
    number = face[cell[rows]]
    order = rows_by_number(number, n_faces)
    ends = np.cumsum(np.bincount(number, minlength=n_faces)).tolist()
    rows = rows[order]
    return [rows[begin:end] for begin, end in pairwise([0, *ends])]
