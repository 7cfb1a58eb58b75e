"""The partition of an outline into roof faces."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.neighbours.few_rows import rows_by_group, sort_rows
from lidar_buildings.core.neighbours.union_find import flatten, link, numbered, sets_of_pairs
from lidar_buildings.core.solids.plan_graph import cut_at
from lidar_buildings.core.stages.building_model.cell_costs import ABOVE, plane_costs, point_weights
from lidar_buildings.core.stages.building_model.cells import (
    Cells,
    cells_of_points,
    cut_into_cells,
    extend_segments,
    face_rings,
)
from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.core.stages.building_model.result import RoofFacePatch
from lidar_buildings.core.stages.building_model.simplification import simplified


def join_equal_cells(cells: Cells, labels: IntArray) -> IntArray:
    """Number the connected groups of cells of one plane, from 0 in the order of their first cells."""
    left, right = cells.sides[(cells.sides[:, 0] >= 0) & (cells.sides[:, 1] >= 0)].T
    same = labels[left] == labels[right]
    return numbered(sets_of_pairs(len(labels), left[same], right[same]))


def parts_of_one_height(cells: Cells, face: IntArray, planes: FloatArray, min_step: float) -> IntArray:
    """
    Number the parts of a roof, from 0: faces that meet, or are parted by a low step only, belong together.

    Two parts are parted by a mean step of `min_step` [m] along their common border.
    """
    return numbered(_parts(cells.vertices, cells.borders, cells.sides, face, planes, min_step))


@kernel
def _parts(vertices, borders, sides, face, planes, min_step):  # type: ignore[no-untyped-def]
    n, m = len(planes), 0
    keys, rows = np.empty(len(borders), np.int64), np.empty(len(borders), np.int64)
    for e in range(len(borders)):
        left = face[sides[e, 0]] if sides[e, 0] >= 0 else -1
        right = face[sides[e, 1]] if sides[e, 1] >= 0 else -1
        if left >= 0 and right >= 0 and left != right:
            keys[m], rows[m] = min(left, right) * n + max(left, right), e
            m += 1
    sort_rows(keys, rows, m)
    parent = np.arange(n)
    step, length = 0.0, 0.0
    for k in range(m):
        low, high = keys[k] // n, keys[k] % n
        a, b, c = planes[low] - planes[high]
        ax, ay = vertices[borders[rows[k], 0]]
        bx, by = vertices[borders[rows[k], 1]]
        first, last = a * ax + b * ay + c, a * bx + b * by + c
        mean = 0.5 * abs(first + last)
        if first * last < 0.0:
            # Where the planes cross on the way, the mean of two triangles.
            mean = 0.5 * (first**2 + last**2) / max(abs(first - last), 1e-12)
        step += math.hypot(bx - ax, by - ay) * mean
        length += math.hypot(bx - ax, by - ay)
        if k + 1 == m or keys[k + 1] != keys[k]:
            if step < min_step * length:
                link(parent, low, high)
            step, length = 0.0, 0.0
    flatten(parent)
    return parent


def with_level_tops(faces: list[RoofFacePatch], points: FloatArray, spacing: float) -> list[RoofFacePatch]:
    """
    Cut off what rises above all points, as where a whole slope of a roof has none.

    A plane is good where its points are, and for a spacing beyond. There the roof is level, at the height of
    the highest return.
    """
    planes, exteriors = np.array([face.plane for face in faces]), [face.rings[0] for face in faces]
    sizes = np.array([len(ring) for ring in exteriors])
    xy, own = np.concatenate(exteriors), np.repeat(planes, sizes, axis=0)
    highest = np.maximum.reduceat(np.einsum("ij,ij->i", own[:, :2], xy) + own[:, 2], np.cumsum(sizes) - sizes)
    tops = points[:, 2].max() + ABOVE + spacing * np.hypot(planes[:, 0], planes[:, 1])
    return [
        piece
        for face, high, top in zip(faces, highest.tolist(), tops.tolist(), strict=True)
        for piece in ([face] if high <= top else _cut_off(face, top))
    ]


def _cut_off(face: RoofFacePatch, top: float) -> list[RoofFacePatch]:
    """Return the pieces of a face below an elevation, the first with its points, and level ones."""
    above, below = cut_at(face.rings, face.plane, top)
    level, none = np.array([0.0, 0.0, top]), face.rows[:0]
    return [
        *(replace(face, rings=rings, rows=none if k else face.rows) for k, rings in enumerate(below)),
        *(replace(face, rings=rings, plane=level, rows=none) for rings in above),
    ]


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
    face = join_equal_cells(cells, labels)
    rings = face_rings(cells, face, outline)
    own = np.empty((len(rings), 3))
    own[face] = planes[labels]
    part = parts_of_one_height(cells, face, own, config.min_part_step).tolist()
    of_faces, first = rows_by_group(1 + np.append(face, -1)[cell], len(rings) + 1)
    rows = [of_faces[begin:end] for begin, end in pairwise(first[1:].tolist())]
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
