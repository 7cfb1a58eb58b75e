"""Pieces of intersection lines as segments in space, their ends where the line meets something."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.stages.roof_topology.common_vertices import POINT_REACH
from lidar_buildings.core.stages.roof_topology.obstacles import stop
from lidar_buildings.core.stages.roof_topology.pieces import LEAST_BEND, Pieces, intersection_lines
from lidar_buildings.core.stages.roof_topology.result import HIP, RIDGE, VALLEY, IntersectionSegment
from lidar_buildings.core.surfaces.roof_planes import CommonVertex

#: A convex line is a ridge if it is less steep than this share of the steeper plane.
_RIDGE_SHARE = 0.3
#: Ends move to a third plane, or else to the outline or a step edge, within so many spacings.
_PLANE_REACH, _REACH = 4.5, 2.5
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
    vertices: tuple[CommonVertex, ...],
    spacing: float,
) -> list[IntersectionSegment]:
    """
    Return the pieces as segments, their ends moved along the line to what they nearly reach.

    A third plane that meets both has precedence, then the outline and step edges. Planes, walls and steps are
    about the centre; at `vertices` planes have been made to meet.
    """
    stops = np.concatenate([walls, steps])
    partners = _partners(pieces, len(gradients))
    positions, members = _points_of(vertices, len(gradients), centre)
    lines = intersection_lines(pieces.first, pieces.second, gradients)
    t = _moved_ends(
        pieces.first, pieces.second, pieces.t, gradients, lines, partners, stops, positions, members, spacing
    )
    kept = np.flatnonzero(t[:, 1] - t[:, 0] > _SHORTEST * spacing)
    return _segments(pieces, kept, t[kept], gradients, centre)


def _partners(pieces: Pieces, n_planes: int) -> BoolArray:
    table = np.zeros((n_planes + 1, n_planes + 1), dtype=np.bool_)
    table[pieces.first, pieces.second] = table[pieces.second, pieces.first] = True
    return table


def _points_of(
    vertices: tuple[CommonVertex, ...], n_planes: int, centre: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return where planes meet in points about the centre, and which planes each time, as a table."""
    points = [vertex for vertex in vertices if not vertex.fixed]
    members = np.zeros((len(points), n_planes + 1), dtype=np.bool_)
    for row, vertex in zip(members, points, strict=True):
        row[list(vertex.planes)] = True
    positions = np.array([vertex.xy for vertex in points]).reshape(-1, 2)
    return positions - centre[:2], members


@kernel
def _moved_ends(first, second, t, gradients, lines, partners, stops, positions, members, spacing):  # type: ignore[no-untyped-def]
    """
    Return the places of all ends along their lines.

    No end moves to where the other one is to end, but for stubs that end nowhere else: they vanish.
    """
    moved = t.copy()
    for k in range(len(first)):
        i, j = first[k], second[k]
        fx, fy, ux, uy = lines[k, 0], lines[k, 1], lines[k, 2], lines[k, 3]
        for end in range(2):
            here, there = t[k, end], t[k, 1 - end]
            point = _point(here, i, j, ux, uy, positions, members, POINT_REACH * spacing)
            at = point if abs(point - there) >= abs(point - here) else math.nan
            if math.isnan(at):
                reach = _PLANE_REACH * spacing
                at = _third_plane(here, i, j, fx, fy, ux, uy, gradients, partners, reach)
                if abs(at - there) < abs(at - here):
                    at = math.nan
            if math.isnan(at):
                at = stop(here, fx, fy, ux, uy, stops, _REACH * spacing, _CORNER * spacing, -1)
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


@kernel
def _third_plane(t, i, j, fx, fy, ux, uy, gradients, partners, reach):  # type: ignore[no-untyped-def]
    """
    Return where on the line of planes i and j the nearest plane that meets both passes, NaN if none does.
    """
    best, place = reach, math.nan
    for k in range(1, len(gradients) + 1):
        if k in (i, j) or not (partners[i, k] and partners[j, k]):
            continue
        a, b = gradients[i - 1, 0] - gradients[k - 1, 0], gradients[i - 1, 1] - gradients[k - 1, 1]
        c = gradients[i - 1, 2] - gradients[k - 1, 2]
        rate = a * ux + b * uy
        if abs(rate) < LEAST_BEND:
            continue
        at = -(a * fx + b * fy + c) / rate
        if abs(at - t) < best:
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
