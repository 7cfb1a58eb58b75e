"""Step edges: straight pieces of the borders between planes that do not meet there."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.stages.roof_topology.directions import (
    main_directions,
    plane_directions,
    wall_directions,
)
from lidar_buildings.core.stages.roof_topology.intersections import stop
from lidar_buildings.core.stages.roof_topology.regions import Borders
from lidar_buildings.core.stages.roof_topology.result import StepEdge
from lidar_buildings.core.surfaces.ring_division import divide_chain, normal_angle, running_sums, scatter_of


class StepLines(NamedTuple):
    """Straight lines in plan, and the pieces of them that are steps."""

    angle: FloatArray  #: direction [rad], shape (n_lines,)
    offset: FloatArray  #: distance from the centre to the left of that direction [m], shape (n_lines,)
    line: IntArray  #: line that each step lies on, shape (n_steps,)
    t: FloatArray  #: its ends along the line [m], shape (n_steps, 2)
    planes: NDArray[np.int32]  #: numbers of the upper and the lower plane, shape (n_steps, 2)
    length: FloatArray  #: length of the border along it [m], shape (n_steps,)
    #: How far the nearest points of the upper roof lie from the line in the mean, or usually [m], shape
    #: (n_lines,).
    gap: FloatArray


def step_edges(
    steps: StepLines, segments: FloatArray, gradients: FloatArray, centre: FloatArray
) -> list[StepEdge]:
    """Return the pieces, whose segments are given, as edges with the heights of their ends."""
    extent = np.hypot(*(segments[:, 1] - segments[:, 0]).T)
    difference = gradients[steps.planes[:, 0] - 1] - gradients[steps.planes[:, 1] - 1]
    rise = np.einsum("kex,kx->ke", segments, difference[:, :2]) + difference[:, 2:]
    columns = (segments + centre[:2], rise.tolist(), steps.planes.tolist(), steps.length.tolist())
    return [
        StepEdge(upper, lower, segment, (first, last), length)
        for is_line, segment, (first, last), (upper, lower), length in zip(
            extent > 0.0, *columns, strict=True
        )
        if is_line
    ]


def step_segments(steps: StepLines) -> FloatArray:
    """Return the ends of all steps about the centre, shape (n_steps, 2, 2) [m]."""
    angle, offset = steps.angle[steps.line], steps.offset[steps.line]
    along = np.column_stack([np.cos(angle), np.sin(angle)])
    left = np.column_stack([-along[:, 1], along[:, 0]])
    return np.asarray((offset[:, None] * left)[:, None] + steps.t[:, :, None] * along[:, None])


def step_chains(
    xy: FloatArray, upright: BoolArray, upper: IntArray, top: FloatArray, cell: float
) -> tuple[IntArray, IntArray, BoolArray]:
    """
    Order the sides of cells along the steps that they make up.

    Where more than two steps meet, the wall of the highest roof goes on. Sides are given by their middles,
    whether they are `upright`, their upper plane and its elevation there, and their length. Returned are
    their rows chain by chain, where each chain begins in these, and which chains go round.
    """
    # Corners of cells are whole numbers of half-sides from one another.
    column, row = np.rint((xy - xy.min(axis=0, initial=0.0)) / (0.5 * cell)).astype(np.int64).T + 1
    width = int(column.max(initial=0)) + 2
    place, reach = row * width + column, np.where(upright, width, 1)
    ends = np.column_stack([place - reach, place + reach]).reshape(-1)
    return _walked(_linked(ends, np.argsort(ends, kind="stable"), upper, top))


@kernel
def _linked(ends, order, upper, top):  # type: ignore[no-untyped-def]
    """Return which end each end of a side goes on at, -1 for none; side k has the ends 2k and 2k + 1."""
    follows = np.full(len(ends), -1, np.int64)
    begin = 0
    for i in range(1, len(order) + 1):
        if i < len(order) and ends[order[i]] == ends[order[begin]]:
            continue
        around = order[begin:i]
        begin = i
        if len(around) == 2:
            follows[around[0]], follows[around[1]] = around[1], around[0]
        for _ in range(len(around) // 2 if len(around) > 2 else 0):
            one, other = _highest_pair(around, follows, upper, top)
            if one >= 0:
                follows[one], follows[other] = other, one
    return follows


@kernel
def _highest_pair(around, follows, upper, top):  # type: ignore[no-untyped-def]
    """Return two ends that are still free at which the wall of one roof goes on, of the highest; or -1."""
    one, other, highest = -1, -1, -np.inf
    for p in around:
        for q in around:
            is_free = p < q and follows[p] < 0 and follows[q] < 0
            if is_free and upper[p >> 1] == upper[q >> 1] and top[p >> 1] > highest:
                one, other, highest = p, q, top[p >> 1]
    return one, other


@kernel
def _walked(follows):  # type: ignore[no-untyped-def]
    """Return the sides chain by chain, where each chain begins, and whether it is closed: open ones first."""
    n = len(follows) // 2
    order, begin = np.empty(n, np.int64), np.zeros(n + 1, np.int64)
    is_closed, is_used = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    at, n_chains = 0, 0
    for closed in range(2):
        for k in range(n):
            if is_used[k] or (closed == 0 and follows[2 * k] >= 0 and follows[2 * k + 1] >= 0):
                continue
            leave = 2 * k if follows[2 * k] >= 0 else 2 * k + 1
            while True:
                is_used[leave >> 1] = True
                order[at] = leave >> 1
                at += 1
                enter = follows[leave]
                if enter < 0 or is_used[enter >> 1]:
                    break
                leave = enter ^ 1
            is_closed[n_chains] = closed == 1
            n_chains += 1
            begin[n_chains] = at
    return order, begin[: n_chains + 1], is_closed[:n_chains]


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
    Divide chains of sides, see `step_chains`, into straight runs, in the best way for what lines cost.

    `angles` are directions that lines may have for nothing [rad]; `cell` is the length of a side. Returned
    are angle and offset from the origin to the left of it, (n_runs, 2), and which run each side lies on.
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
        first, kind = _divided(sums, n, np.int64(0), cosines, sines, noise)
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


@inner_kernel
def _divided(sums, n, shift, cosines, sines, noise):  # type: ignore[no-untyped-def]
    """Return first side and kind of each line, last to first; steps are as in outlines, without arcs."""
    first, kind, _ = divide_chain(
        sums, n, shift, 1.0, cosines, sines, noise, _LINE, _OWN_DIRECTION, _LINE, np.inf, 0.0, np.bool_(False)
    )
    return first, kind


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
    directions = wall_directions(walls), plane_directions(gradients, area)
    main = main_directions(*(np.concatenate(both) for both in zip(*directions, strict=True)))
    angles = np.concatenate([main, main + math.pi / 2])
    runs, run = straight_runs(xy, chains, angles, borders.cell, spacing)
    angle, offset = runs[run, 0], runs[run, 1]
    t = xy[:, 0] * np.cos(angle) + xy[:, 1] * np.sin(angle)
    # How far the upper roof's nearest points lie to the left of each side's line [m].
    away = points[np.where(higher, borders.near_first[rows], borders.near_second[rows]), :2] - centre[:2]
    beside = away[:, 1] * np.cos(angle) - away[:, 0] * np.sin(angle) - offset
    weight = np.bincount(run, minlength=len(runs))
    mean = np.bincount(run, beside, len(runs)) / np.maximum(weight, 1)
    planes = np.column_stack([upper, first + second - upper])
    line, ends, planes, length = _pieces(run, t, planes, borders.cell, spacing)
    gap = np.maximum(np.abs(mean), _USUAL_GAP * spacing)
    return StepLines(runs[:, 0], runs[:, 1], line, ends, planes, length, gap)


def _elevations(gradients: FloatArray, xy: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ki,ki->k", gradients[:, :2], xy) + gradients[:, 2])


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


#: Ends move along their line to what they cross within so many spacings; others may end as far off.
_END_REACH = 2.5
#: A line moves no farther than so many spacings past the upper roof's points,
_PAST_POINTS = 0.25
#: to a wall or corner that is so near along it, in spacings, and that runs in nearly its direction [deg].
_REACH, _PARALLEL_DEG = 4.0, 4.0


def snapped(steps: StepLines, walls: FloatArray, spacing: float) -> StepLines:
    """
    Move lines onto outline walls, about the centre, that they continue, else into corners that they end near.

    Where in the gap between the points of both roofs a step lies is not known: what it continues tells.
    """
    if not len(steps.angle):
        return steps
    angle, offset = steps.angle.copy(), steps.offset.copy()
    # From where to where each line has pieces; the other way round where it has none.
    low, high = np.full(len(angle), np.inf), np.full(len(angle), -np.inf)
    np.minimum.at(low, steps.line, steps.t[:, 0])
    np.maximum.at(high, steps.line, steps.t[:, 1])
    _onto_walls(angle, offset, low, high, steps.gap, walls, spacing)
    # A line that turned with its wall has its ends a little farther along or back.
    turn = angle[steps.line] - steps.angle[steps.line]
    t = steps.t * np.cos(turn)[:, None] + (steps.offset[steps.line] * np.sin(turn))[:, None]
    return steps._replace(angle=angle, offset=offset, t=t)


@kernel
def _onto_walls(angle, offset, low, high, gap, walls, spacing):  # type: ignore[no-untyped-def]
    past, reach = _PAST_POINTS * spacing, _REACH * spacing
    for k in range(len(angle)):
        if not low[k] < high[k]:
            continue
        c, s = math.cos(angle[k]), math.sin(angle[k])
        best, best_angle, best_offset, is_moved = gap[k] + past, 0.0, 0.0, False
        for m in range(len(walls)):
            x, y = walls[m, 0, 0], walls[m, 0, 1]
            dx, dy = walls[m, 1, 0] - x, walls[m, 1, 1] - y
            length = math.hypot(dx, dy)
            if length < spacing or abs(dx * s - dy * c) > math.sin(math.radians(_PARALLEL_DEG)) * length:
                continue
            t0 = x * c + y * s
            t1 = walls[m, 1, 0] * c + walls[m, 1, 1] * s
            if min(t0, t1) > high[k] + reach or max(t0, t1) < low[k] - reach:
                continue
            turned = math.atan2(dy, dx) if dx * c + dy * s > 0 else math.atan2(-dy, -dx)
            at = y * math.cos(turned) - x * math.sin(turned)
            off = max(
                _apart(angle[k], offset[k], low[k], turned, at),
                _apart(angle[k], offset[k], high[k], turned, at),
            )
            if off < best:
                best, best_angle, best_offset, is_moved = off, turned, at, True
        if is_moved:
            angle[k] = angle[k] + _difference(best_angle, angle[k])
            offset[k] = best_offset
            continue
        best = gap[k] + past
        for m in range(len(walls)):
            x, y = walls[m, 0, 0], walls[m, 0, 1]
            t, r = x * c + y * s, y * c - x * s
            if min(abs(t - low[k]), abs(t - high[k])) <= reach and abs(r - offset[k]) < best:
                best, best_offset, is_moved = abs(r - offset[k]), r, True
        if is_moved:
            offset[k] = best_offset


@inner_kernel
def _difference(one, other):  # type: ignore[no-untyped-def]
    turn = one - other
    return turn - 2.0 * math.pi * np.rint(turn / (2.0 * math.pi))


@inner_kernel
def _apart(angle, offset, t, other_angle, other_offset):  # type: ignore[no-untyped-def]
    x = t * math.cos(angle) - offset * math.sin(angle)
    y = t * math.sin(angle) + offset * math.cos(angle)
    return abs(y * math.cos(other_angle) - x * math.sin(other_angle) - other_offset)


def extended(steps: StepLines, ridges: FloatArray, walls: FloatArray, spacing: float) -> StepLines:
    """Move the ends of steps along their lines to walls, other steps and intersection lines that are near."""
    if not len(steps.line):
        return steps
    angle, offset = steps.angle[steps.line], steps.offset[steps.line]
    reach = _END_REACH * spacing
    t = _extended(steps.t, angle, offset, walls, np.concatenate([step_segments(steps), ridges]), reach)
    return steps._replace(t=t)


@kernel
def _extended(t, angle, offset, walls, others, reach):  # type: ignore[no-untyped-def]
    """Return the new ends; the first of the others are the steps themselves."""
    moved = t.copy()
    for k in range(len(t)):
        ux, uy = math.cos(angle[k]), math.sin(angle[k])
        fx, fy = -offset[k] * uy, offset[k] * ux
        for end in range(2):
            wall = stop(t[k, end], fx, fy, ux, uy, walls, reach, 0.2 * reach, np.int64(-1))
            other = stop(t[k, end], fx, fy, ux, uy, others, reach, reach, k)
            if math.isnan(wall) or abs(other - t[k, end]) < abs(wall - t[k, end]):
                wall = other
            if not math.isnan(wall):
                moved[k, end] = wall
    return moved
