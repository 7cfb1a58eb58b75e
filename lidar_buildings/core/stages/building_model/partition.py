"""The partition of an outline into roof faces."""

from __future__ import annotations

import math
from itertools import chain, pairwise

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.neighbours.few_rows import rows_by_group, sort_rows
from lidar_buildings.core.neighbours.union_find import flatten, link, numbered, sets_of_pairs
from lidar_buildings.core.stages.building_model.cell_costs import plane_costs, point_weights
from lidar_buildings.core.stages.building_model.cells import (
    Cells,
    cells_of_points,
    cut_again,
    cut_into_cells,
    extend_segments,
    face_corners,
    face_rings,
)
from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.core.stages.building_model.contraction import contracted
from lidar_buildings.core.stages.building_model.result import RoofFacePatch
from lidar_buildings.core.stages.building_model.simplification import simplified
from lidar_buildings.core.stages.building_model.spikes import limits_of


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
    n, m = len(planes), np.int64(0)
    keys, rows = np.empty(len(borders)), np.empty(len(borders), np.int64)
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
        low, high = divmod(np.int64(keys[k]), n)
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


#: Rounds in which a roof is divided until points explain all its corners, at most.
_MOST_ROUNDS = 16
#: A plane that is not allowed over a cell costs so much there [m³], more than a face that is too small.
_NOT_ALLOWED = 1e7
#: A point so near to its plane agrees with it [m].
_AGREES = 0.3


# Those with which `bench.models.run` divides the virtual roofs into their true faces; below 0.07 m³ a corner,
# roofs that people drew get parts that they did not draw.
#: Cost of a metre of border between two roof faces, as a misfit over an area [spacings].
_BORDER_COST = 0.15
#: Cost of a corner [m³].
_CORNER_COST = 0.1
#: Walls of a re-entrant corner run on into the roof where they turn by more than this [rad].
_REENTRANT = 0.35


#: A step is higher [m]. A block on a roof is part of the building from this area on (LoD2.0 of Biljecki and
#: others, 2016) [m²].
_STEP, _LEAST_PART = 0.5, 10.0
#: What it costs to keep a cell of what is left out as it is [m³].
_LEFT_OUT = 1e4


def _without_superstructures(
    cells: Cells, labels: IntArray, costs: FloatArray, planes: FloatArray
) -> FloatArray:
    """
    Return costs by which what stands on a roof goes, and the planes around it run on.

    These are faces that do not reach the outline and end in a step somewhere: dormers and lanterns, which a
    larger face meets without a step elsewhere, and blocks on a larger face that are too small to be parts.
    """
    face = join_equal_cells(cells, labels)
    n = face.max(initial=-1) + 1
    sides = np.where(cells.sides >= 0, face[cells.sides], -1)
    own, area = np.empty((n, 3)), np.bincount(face, cells.areas)
    is_inner, is_joined, is_beside = np.zeros((3, n), np.bool_)
    own[face] = planes[labels]
    is_border = (sides >= 0).all(axis=1) & (sides[:, 0] != sides[:, 1])
    beside, ends = sides[is_border], cells.vertices[cells.borders[is_border]]
    between = own[beside[:, 0]] - own[beside[:, 1]]
    rise = np.einsum("ij,ikj->ik", between[:, :2], ends) + between[:, 2:]
    is_step = (np.abs(rise) > _STEP).any(axis=1)
    is_inner[beside[is_step]] = True
    is_inner[sides[(sides < 0).any(axis=1)].max(axis=1)] = False
    one, other = np.concatenate([beside, beside[:, ::-1]]).T
    is_larger = area[other] > area[one]
    is_beside[one[is_larger]] = True
    is_joined[one[is_larger & ~np.tile(is_step, 2) & ~is_inner[other]]] = True
    goes = (is_inner & (is_joined | (is_beside & (area < _LEAST_PART))))[face]
    runs_on = np.zeros(len(planes), np.bool_)
    runs_on[labels[~goes]] = True
    costs = costs.copy()
    costs[goes] = np.where(runs_on, 0.0, _LEFT_OUT)
    costs[goes, labels[goes]] = _LEFT_OUT
    return costs


def partition_outline(
    outline: Outline,
    points: FloatArray,
    planes: FloatArray,
    lines: tuple[FloatArray, FloatArray],
    spacing: float,
    config: BuildingModelConfig,
    floor: float = -math.inf,
    *,
    is_main: bool = False,
) -> list[RoofFacePatch]:
    """
    Divide an outline, valid and on the output grid, into roof faces.

    Ridges, hips, valleys and steps, run on to the next line, cut the outline into cells; every cell gets the
    plane that fits the points best at the least length of borders and number of corners; cells of one plane
    are joined, and their vertices moved into neighbours where that costs less. Points, (n_points, 3), rise by
    y. `lines` are first steps and then lines in which planes meet, in plan. `is_main` leaves out what stands
    on the roof.

    Where a corner of a face leaves what points near explain (`Limits`), its plane may not be there: the cell
    is cut between the points that agree and the corner, or is offered a level roof, and planes are chosen
    again, faces whole. No roof lies below `floor` [m] where no point does.
    """
    cuts = lines[0][:0]
    if len(planes) > 1:
        segments = np.concatenate([*lines, *map(_reentrant_walls, outline.rings)])
        cuts = extend_segments(segments, ring_walls(outline.rings), len(lines[0]))
    weights = point_weights(points, outline.exterior, spacing)
    prices = _BORDER_COST * spacing, _CORNER_COST
    limits, left = limits_of(points, spacing, floor), np.empty((0, 3))
    cells = cut_into_cells(outline, cuts)
    for rounds_left in reversed(range(_MOST_ROUNDS)):
        cell = cells_of_points(cells, points)
        costs = plane_costs(points, limits.near, weights, cell, cells, planes, spacing)
        not_allowed = limits.not_allowed(cells, planes, left)
        costs[not_allowed] = _NOT_ALLOWED
        labels = simplified(cells, np.argmin(costs, axis=1), costs, planes, prices, config.min_face_area)
        if is_main:
            costs = _without_superstructures(cells, labels, costs, planes)
            costs[not_allowed] = _NOT_ALLOWED
            labels = simplified(cells, labels, costs, planes, prices, config.min_face_area)
        face, own = join_equal_cells(cells, labels), planes[labels]
        at, corners = limits.corners_left(cells, own, face_corners(cells, face, outline))
        if not len(at) or not rounds_left:
            break
        left = np.concatenate([left, corners])
        new_cuts: list[FloatArray] = []
        heights: list[float] = []
        for c in np.unique(at).tolist():
            polygon, over = cells.polygons[c], points[cell == c]
            seen = over[np.abs(over[:, :2] @ own[c, :2] + own[c, 2] - over[:, 2]) <= _AGREES, :2]
            its = corners[at == c, :2] if len(seen) else ()
            new = [limits.cut_off(polygon, seen, corner) for corner in its]
            if not (new and all(new)):
                more, levels = limits.level(polygon, over, left)
                new, heights = [*new, more], heights + levels
            new_cuts += chain(*new)
        planes = np.concatenate([planes, *([[0.0, 0.0, z]] for z in heights)])
        alone = labels.copy()
        alone[at] = len(planes) + at
        cells = cut_again(cells, join_equal_cells(cells, alone), np.array(new_cuts).reshape(-1, 2, 2))
    rings = face_rings(cells, face, outline)
    of_face = np.empty((len(rings), 3))
    of_face[face] = own
    part = parts_of_one_height(cells, face, of_face, config.min_part_step).tolist()
    over = np.append(face, -1)[cell]
    rings = contracted(rings, of_face, over, np.concatenate(outline.rings), limits, points, weights, prices)
    of_faces, first = rows_by_group(1 + over, len(rings) + 1)
    rows = [of_faces[begin:end] for begin, end in pairwise(first[1:].tolist())]
    return [RoofFacePatch(*each) for each in zip(rings, of_face, rows, part, strict=True) if each[0]]


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
