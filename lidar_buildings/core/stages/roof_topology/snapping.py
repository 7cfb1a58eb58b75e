"""Lines of step edges moved onto walls and into corners where they nearly are."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.stages.roof_topology.obstacles import stop
from lidar_buildings.core.stages.roof_topology.step_lines import StepLines, extents_of, step_segments

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
    _onto_walls(angle, offset, *extents_of(steps), steps.gap, walls, spacing)
    # A line that turned with its wall has its ends a little farther along or back.
    turn = angle[steps.line] - steps.angle[steps.line]
    t = steps.t * np.cos(turn)[:, None] + (steps.offset[steps.line] * np.sin(turn))[:, None]
    return steps._replace(angle=angle, offset=offset, t=t)


@kernel
def _onto_walls(angle, offset, low, high, gap, walls, spacing):  # type: ignore[no-untyped-def]
    """Move lines in place."""
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


@kernel
def _difference(one, other):  # type: ignore[no-untyped-def]
    """Difference of two angles between -π and π."""
    turn = one - other
    return turn - 2.0 * math.pi * np.rint(turn / (2.0 * math.pi))


@kernel
def _apart(angle, offset, t, other_angle, other_offset):  # type: ignore[no-untyped-def]
    """Distance of a position on one line from another line."""
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
            wall = stop(t[k, end], fx, fy, ux, uy, walls, reach, 0.2 * reach, -1)
            other = stop(t[k, end], fx, fy, ux, uy, others, reach, reach, k)
            if math.isnan(wall) or abs(other - t[k, end]) < abs(wall - t[k, end]):
                wall = other
            if not math.isnan(wall):
                moved[k, end] = wall
    return moved
