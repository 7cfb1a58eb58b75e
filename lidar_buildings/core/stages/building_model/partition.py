"""The partition of an outline into roof faces."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import shapely

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.neighbours.few_rows import rows_by_group, sort_rows
from lidar_buildings.core.neighbours.union_find import flatten, link, numbered, sets_of_pairs
from lidar_buildings.core.solids.output_grid import GRID, made_valid, polygons_of
from lidar_buildings.core.solids.plan_graph import cut_at, rings_of
from lidar_buildings.core.stages.building_model.cell_costs import (
    ABOVE,
    AROUND,
    heights_near,
    plane_costs,
    point_weights,
)
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


#: What a roof may lie above or below the points around, beside what the spacing explains [m].
_OFF = 0.5
#: A point so near to its face agrees with it [m]; so many of them tell how far its plane holds.
_AGREES, _LEAST_POINTS = 0.3, 3
#: A plane whose points reach no further along its slope, as a standard deviation, has none [spacings].
_LEAST_REACH = 0.5
#: A plane holds so far beyond the points that agree with it [spacings]; smaller pieces beside them stay [m²].
_PAST, _LEAST_AREA = 1.5, 0.2
#: A plane of a lower slope is level.
_FLAT = 1e-6


def with_level_ends(faces: list[RoofFacePatch], points: FloatArray, spacing: float) -> list[RoofFacePatch]:
    """
    Cut off what rises above, or sinks below, all points around, as where a slope of a roof has none.

    A plane is good where its points are, and for a spacing beyond. There the roof is level: at the height of
    the last point, or of what is seen around. A plane that hardly more than one row of points tells has no
    spacing beyond, as nothing says how steep it is. Points rise by y.
    """
    planes, exteriors = np.array([face.plane for face in faces]), [face.rings[0] for face in faces]
    sizes = np.array([len(ring) for ring in exteriors])
    xy, own = np.concatenate(exteriors), np.repeat(planes, sizes, axis=0)
    z = np.einsum("ij,ij->i", own[:, :2], xy) + own[:, 2]
    slack = spacing * np.array([_steepness(face, points, spacing) for face in faces])
    low, high = _ends_around(xy, points, spacing)
    high = np.minimum(high, points[:, 2].max())  # where nothing is near
    margin = _OFF + np.repeat(slack, sizes)
    first = np.cumsum(sizes) - sizes
    off = np.column_stack(
        [np.logical_or.reduceat(one, first) for one in (z > high + margin, z < low - margin)]
    )
    found: list[RoofFacePatch] = []
    for face, reach, ends in zip(faces, slack.tolist(), off.tolist(), strict=True):
        found += _levelled(face, points, spacing, reach, ends) if any(ends) else [face]
    return found


def _steepness(face: RoofFacePatch, points: FloatArray, spacing: float) -> float:
    """Return the slope of a face, 0 where its points do not tell any."""
    slope = float(np.hypot(*face.plane[:2]))
    if slope < 1.0 or not len(face.rows):
        return slope if slope < 1.0 else 0.0
    along = points[face.rows, :2] @ (face.plane[:2] / slope)
    return slope if along.std() > _LEAST_REACH * spacing else 0.0


def _levelled(
    face: RoofFacePatch, points: FloatArray, spacing: float, slack: float, is_off: list[bool]
) -> list[RoofFacePatch]:
    """Return the pieces of a face up to its highest, down to its lowest own point, and level ones beyond."""
    low, high = _ends_around(face.rings[0], points, spacing)
    z = face.rings[0] @ face.plane[:2] + face.plane[2]
    if not (is_off[0] or ((z > high + _OFF + slack) | (z < low - _OFF - slack)).any()):
        return [face]
    own = points[face.rows]
    z = own[:, :2] @ face.plane[:2] + face.plane[2]
    agrees = np.abs(own[:, 2] - z) <= _AGREES
    if np.count_nonzero(agrees) < _LEAST_POINTS:
        return [_level(face.rings, points, spacing, face)]
    ends, rest = [], [face.rings]
    limits = (z[agrees].max() + ABOVE + slack, z[agrees].min() - ABOVE - slack)
    is_sloping = np.hypot(*face.plane[:2]) > _FLAT
    for inside, (end, is_beyond) in enumerate(zip(limits[::-1], is_off[::-1], strict=True)):
        if is_beyond and is_sloping:  # what is above the lower end is inside, and what is below the upper one
            cuts = [cut_at(rings, face.plane, end) for rings in rest]
            rest = [rings for cut in cuts for rings in cut[inside]]
            ends += [(rings, end) for cut in cuts for rings in cut[1 - inside]]
    kept: list[tuple[FloatArray, ...]] = []
    for rings in rest:
        inner, outer = _parted(rings, face.plane, own[agrees, :2], points, spacing, slack)
        kept += inner
        ends += [(part, None) for part in outer]
    pieces = [
        replace(face, rings=rings, rows=face.rows if not k else face.rows[:0]) for k, rings in enumerate(kept)
    ]
    return pieces + [_level(rings, points, spacing, face, end, bool(pieces)) for rings, end in ends]


def _parted(
    rings: tuple[FloatArray, ...],
    plane: FloatArray,
    seen: FloatArray,
    points: FloatArray,
    spacing: float,
    slack: float,
) -> tuple[list[tuple[FloatArray, ...]], list[tuple[FloatArray, ...]]]:
    """Part from a face what lies beside the points that agree with it and has vertices off those around."""
    z = rings[0] @ plane[:2] + plane[2]
    low, high = _ends_around(rings[0], points, spacing)
    off = shapely.multipoints(rings[0][(z > high + _OFF + slack) | (z < low - _OFF - slack)])
    if off.is_empty:
        return [rings], []
    around = shapely.oriented_envelope(shapely.multipoints(seen)).buffer(_PAST * spacing, join_style="mitre")
    (whole,) = made_valid(np.array([shapely.Polygon(rings[0], rings[1:])], dtype=object))
    beside = [one for one in polygons_of(whole.difference(around)) if one.area >= _LEAST_AREA]
    beside = [one for one in beside if shapely.distance(one, off) < GRID]
    inner = polygons_of(whole.difference(shapely.union_all(beside))) if beside else []
    if not inner:
        return [rings], []
    return [rings_of(one) for one in inner if not one.is_empty], [rings_of(one) for one in beside]


def _ends_around(places: FloatArray, points: FloatArray, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest point within some spacings of each place, infinite without any."""
    low, high = heights_near(places, points, AROUND * spacing)
    return np.where(low > high, -np.inf, low), np.where(low > high, np.inf, high)


def _level(
    rings: tuple[FloatArray, ...],
    points: FloatArray,
    spacing: float,
    face: RoofFacePatch,
    end: float | None = None,
    is_rest: bool = False,
) -> RoofFacePatch:
    """Return a level face, within what is seen around all its vertices, near an elevation if there is one."""
    low, high = _ends_around(rings[0], points, spacing)
    lowest, highest = float(low.max()) - _AGREES, float(high.min()) + _AGREES
    if end is None:
        known = low[np.isfinite(low)], high[np.isfinite(high)]
        end = 0.5 * (known[0].min() + known[1].max()) if len(known[0]) else points[:, 2].max() + ABOVE
        z = min(max(end, lowest), highest) if lowest <= highest else 0.5 * (lowest + highest)
    else:
        z = min(max(end, lowest), highest) if lowest <= highest else end
    rows = face.rows[:0] if is_rest else face.rows
    return replace(face, rings=rings, plane=np.array([0.0, 0.0, float(z)]), rows=rows)


# Those with which `bench.models.run` divides the virtual roofs into their true faces; below 0.07 m³ a corner,
# roofs that people drew get parts that they did not draw.
#: Cost of a metre of border between two roof faces, as a misfit over an area [spacings].
_BORDER_COST = 0.15
#: Cost of a corner [m³].
_CORNER_COST = 0.075
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
    *,
    is_main: bool = False,
) -> list[RoofFacePatch]:
    """
    Divide an outline, valid and on the output grid, into roof faces.

    Ridges, hips, valleys and steps, run on to the next line, cut the outline into cells; every cell gets the
    plane that fits the points best at the least length of borders and number of corners; cells of one plane
    are joined. `lines` are first steps and then lines in which planes meet, in plan. `is_main` leaves out
    what stands on the roof.
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
    if is_main:
        costs = _without_superstructures(cells, labels, costs, planes)
        labels = simplified(cells, labels, costs, planes, prices, config.min_face_area)
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
