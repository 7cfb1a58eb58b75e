"""Ridges, hips and valleys: pieces of the lines in which planes meet, and the vertices where these end."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.neighbours.few_rows import sort_rows
from lidar_buildings.core.stages.roof_topology.regions import Borders
from lidar_buildings.core.stages.roof_topology.result import HIP, RIDGE, VALLEY, IntersectionSegment
from lidar_buildings.core.surfaces.plane_adjustment import POINT, Condition


@kernel
def stop(t, fx, fy, ux, uy, stops, reach, beyond, but):  # type: ignore[no-untyped-def]
    """
    Return where the line crosses the nearest wall or step edge, NaN if there is none near.

    Stops are taken for longer than they are by `beyond` at either end: a line through a corner has to hit one
    of its walls. Stop number `but` is left out.
    """
    best, place = reach, math.nan
    for m in range(len(stops)):
        wx, wy = stops[m, 1, 0] - stops[m, 0, 0], stops[m, 1, 1] - stops[m, 0, 1]
        length = math.hypot(wx, wy)
        across = ux * wy - uy * wx
        if m == but or length == 0.0 or abs(across) < 0.1 * length:
            continue
        dx, dy = stops[m, 0, 0] - fx, stops[m, 0, 1] - fy
        at = (dx * wy - dy * wx) / across
        along = (dx * uy - dy * ux) / across * length
        if -beyond <= along <= length + beyond and abs(at - t) < best:
            best, place = abs(at - t), at
    return place


#: Planes whose slopes differ by less [m/m] have no line of intersection worth the name.
LEAST_BEND = 0.01
#: A border lies on the line if it is no farther from it than the gap between the points and so many spacings,
_TOLERANCE = 0.75
#: at the ends of a piece no farther than so many spacings more than the gap.
_END_TOLERANCE = 0.35
#: Borders so near beside a piece of the line [spacings] are no steps.
_BESIDE = 2.5
#: Shortest piece, and longest gap within one, in spacings.
_LEAST_LENGTH, _LONGEST_GAP = 2.0, 4.0


class Pieces(NamedTuple):
    """Pieces of intersection lines."""

    pair: IntArray  #: pair of the borders, shape (n,)
    #: Numbers of the planes, shape (n,).
    first: NDArray[np.int32]
    second: NDArray[np.int32]
    #: Ends as distances along the line from its foot, the position nearest to the centre [m], shape (n, 2).
    t: FloatArray
    length: FloatArray  #: length of the border along it [m], shape (n,)
    convex: BoolArray  #: whether the planes descend away from the line, shape (n,)
    on_line: BoolArray  #: which sides of the borders are accounted for by a piece, shape (n_sides,)


def find_pieces(
    borders: Borders, points: FloatArray, gradients: FloatArray, centre: FloatArray, spacing: float
) -> Pieces:
    """Find where pairs of planes z = a x + b y + c about the centre meet."""
    n = len(borders.first)
    pairs = np.empty(n, dtype=np.int64)
    values = np.empty((n, 4))
    on_line = np.zeros(n, dtype=np.bool_)
    lines = intersection_lines(
        borders.first[borders.start[:-1]], borders.second[borders.start[:-1]], gradients
    )
    n_pieces = _all_pieces(
        borders.upright, borders.gap, borders.start, borders.cell, lines, borders.xy,
        points[borders.near_first, :2] - centre[:2], points[borders.near_second, :2] - centre[:2],
        spacing, pairs, values, on_line,
    )  # fmt: skip
    pairs, values = pairs[:n_pieces], values[:n_pieces]
    at = borders.start[pairs]
    return Pieces(
        pairs,
        borders.first[at],
        borders.second[at],
        np.ascontiguousarray(values[:, :2]),
        values[:, 2],
        values[:, 3] > 0,
        on_line,
    )


@kernel
def intersection_lines(first, second, gradients):  # type: ignore[no-untyped-def]
    """
    Return foot, direction and bend of the lines in which pairs of planes meet, seen from above.

    The direction is that of the cross product of the normals (Mancera-Taboada et al., 2012, eq. 5). The foot
    is the position nearest to the origin, which is in the building: one at z = 0 may be far off. The bend is
    the difference of the planes' gradients; less than `LEAST_BEND` means that there is no line.
    """
    lines = np.zeros((len(first), 5))
    for k in range(len(first)):
        i, j = first[k] - 1, second[k] - 1
        gx, gy = gradients[i, 0] - gradients[j, 0], gradients[i, 1] - gradients[j, 1]
        d = gradients[i, 2] - gradients[j, 2]
        bend = np.hypot(gx, gy)
        lines[k, 2], lines[k, 4] = 1.0, bend
        if bend >= LEAST_BEND:
            lines[k, 0], lines[k, 1] = -d * gx / bend**2, -d * gy / bend**2
            lines[k, 2], lines[k, 3] = -gy / bend, gx / bend
    return lines


@kernel
def _all_pieces(  # type: ignore[no-untyped-def]
    upright, gap, start, cell, lines, xy, of_first, of_second, spacing, pairs, values, on_line
):  # fmt: skip
    """Write pair, ends, length and vote on convexity of each piece; return how many."""
    n_pieces = 0
    rows, t, off, along = np.empty(len(xy), np.int64), np.empty(len(xy)), np.empty(len(xy)), np.empty(len(xy))
    for pair in range(len(start) - 1):
        a, b = start[pair], start[pair + 1]
        fx, fy, ux, uy, bend = lines[pair, 0], lines[pair, 1], lines[pair, 2], lines[pair, 3], lines[pair, 4]
        if bend < LEAST_BEND:
            continue
        least, strict = _TOLERANCE * spacing, _END_TOLERANCE * spacing
        n = np.int64(0)
        for k in range(a, b):
            x, y = xy[k, 0], xy[k, 1]
            t[k], off[k] = x * ux + y * uy, abs((x - fx) * uy - (y - fy) * ux)
            if off[k] <= least + gap[k]:
                rows[n], along[n] = k, t[k]
                n += 1
        sort_rows(along, rows, n)
        begin, first_piece = 0, n_pieces
        for m in range(1, n + 1):
            if m < n and t[rows[m]] - t[rows[m - 1]] <= _LONGEST_GAP * spacing:
                continue
            # From the first to the last that are surely on the line.
            low, high = begin, m - 1
            while low < high and off[rows[low]] > strict + gap[rows[low]]:
                low += 1
            while low < high and off[rows[high]] > strict + gap[rows[high]]:
                high -= 1
            begin = m
            t0, t1 = t[rows[low]], t[rows[high]]
            length = 0.0
            for at in range(low, high + 1):
                length += cell * (abs(uy) if upright[rows[at]] else abs(ux))
            if length < _LEAST_LENGTH * spacing:
                continue
            votes = 0.0
            for at in range(low, high + 1):
                k = rows[at]
                on_line[k] = True
                # To the left of the line the first plane is the lower one.
                votes += _beside(of_first, k, fx, fy, ux, uy) - _beside(of_second, k, fx, fy, ux, uy)
            pairs[n_pieces] = pair
            values[n_pieces, 0], values[n_pieces, 1], values[n_pieces, 2] = t0, t1, length
            values[n_pieces, 3] = votes
            n_pieces += 1
        # Sides that run beside a piece are accounted for: points of its planes are mixed there, but there is
        # no step.
        for piece in range(first_piece, n_pieces):
            t0, t1 = values[piece, 0] + spacing, values[piece, 1] - spacing
            for k in range(a, b):
                if off[k] <= _BESIDE * spacing + gap[k] and t0 <= t[k] <= t1:
                    on_line[k] = True
    return n_pieces


@inner_kernel
def _beside(place, k, fx, fy, ux, uy):  # type: ignore[no-untyped-def]
    """Return how far to the left of a line a place lies [m]."""
    return ux * (place[k, 1] - fy) - uy * (place[k, 0] - fx)


#: Further planes whose lines end within so many spacings of a common point may pass it, too.
POINT_REACH = 8.0


def piece_ends(pieces: Pieces, gradients: FloatArray) -> FloatArray:
    """Return both ends of every piece in plan about the centre, shape (n_pieces, 2, 2) [m]."""
    lines = intersection_lines(pieces.first, pieces.second, gradients)
    return lines[:, None, :2] + pieces.t[:, :, None] * lines[:, None, 2:4]


#: A convex line is a ridge if it is less steep than this share of the steeper plane.
_RIDGE_SHARE = 0.3
#: Ends move to the outline or a step edge within so many spacings.
_STOP_REACH = 2.5
#: Pieces near a point that lead to nowhere are none if they are no longer than this [spacings].
_STUB = 6.0
#: What is left shorter is nothing but a point, in spacings.
_SHORTEST = 1.0
#: A corner within so many spacings of the end of the line on the outline is that end.
_CORNER = 0.5


def finished(
    pieces: Pieces,
    gradients: FloatArray,
    centre: FloatArray,
    walls: FloatArray,
    steps: FloatArray,
    conditions: tuple[Condition, ...],
    spacing: float,
) -> list[IntersectionSegment]:
    """
    Return the pieces as segments, their ends moved along the line to what they nearly reach.

    A point in which planes are made to meet has precedence over the outline and step edges. Planes, walls and
    steps are about the centre; `conditions` are those that the planes are under.
    """
    stops = np.concatenate([walls, steps])
    positions, members = _points_of(conditions, len(gradients))
    lines = intersection_lines(pieces.first, pieces.second, gradients)
    t = _moved_ends(pieces.first, pieces.second, pieces.t, lines, stops, positions, members, spacing)
    kept = np.flatnonzero(t[:, 1] - t[:, 0] > _SHORTEST * spacing)
    return _segments(pieces, kept, t[kept], gradients, centre)


def _points_of(conditions: tuple[Condition, ...], n_planes: int) -> tuple[FloatArray, BoolArray]:
    """Return where planes meet in points about the centre, and which planes each time, as a table."""
    points = [one for one in conditions if one.kind == POINT]
    members = np.zeros((len(points), n_planes + 1), dtype=np.bool_)
    for row, point in zip(members, points, strict=True):
        row[list(point.planes)] = True
    return np.array([point.xy for point in points]).reshape(-1, 2), members


@kernel
def _moved_ends(first, second, t, lines, stops, positions, members, spacing):  # type: ignore[no-untyped-def]
    """Return the places of all ends along their lines; none passes the other end, but for stubs."""
    moved = t.copy()
    for k in range(len(first)):
        i, j = first[k], second[k]
        fx, fy, ux, uy = lines[k, 0], lines[k, 1], lines[k, 2], lines[k, 3]
        for end in range(2):
            here, there = t[k, end], t[k, 1 - end]
            point = _point(here, i, j, ux, uy, positions, members, POINT_REACH * spacing)
            at = point if abs(point - there) >= abs(point - here) else math.nan
            if math.isnan(at):
                at = stop(here, fx, fy, ux, uy, stops, _STOP_REACH * spacing, _CORNER * spacing, np.int64(-1))
            if math.isnan(at) and abs(there - here) <= _STUB * spacing:
                at = point
            if not math.isnan(at):
                moved[k, end] = at
    return moved


@kernel
def _point(t, i, j, ux, uy, positions, members, reach):  # type: ignore[no-untyped-def]
    """Return where on the line of planes i and j the nearest point lies in which both meet others, or NaN."""
    best, place = reach, math.nan
    for m in range(len(positions)):
        at = positions[m, 0] * ux + positions[m, 1] * uy
        if members[m, i] and members[m, j] and abs(at - t) < best:
            best, place = abs(at - t), at
    return place


def _segments(
    pieces: Pieces, kept: IntArray, t: FloatArray, gradients: FloatArray, centre: FloatArray
) -> list[IntersectionSegment]:
    """Return some of the pieces as segments from and to places on their lines."""
    first, second = pieces.first[kept], pieces.second[kept]
    p, q = gradients[first - 1], gradients[second - 1]
    lines = intersection_lines(first, second, gradients)
    xy = lines[:, None, :2] + t[:, :, None] * lines[:, None, 2:4]
    z = np.einsum("kex,kx->ke", xy, p[:, :2]) + p[:, 2:]
    segments = np.concatenate([xy, z[:, :, None]], axis=2) + centre
    rise = np.einsum("kx,kx->k", p[:, :2], lines[:, 2:4])
    steepness = np.maximum(np.hypot(p[:, 0], p[:, 1]), np.hypot(q[:, 0], q[:, 1]))
    kinds = [_kind(*each) for each in zip(pieces.convex[kept], rise, steepness, strict=True)]
    columns = (first.tolist(), second.tolist(), kinds, segments, pieces.length[kept].tolist())
    return [IntersectionSegment(*each) for each in zip(*columns, strict=True)]


def _kind(convex: bool, rise: float, steepness: float) -> str:
    if not convex:
        return VALLEY
    return RIDGE if abs(rise) < _RIDGE_SHARE * steepness else HIP
