"""Walls laid on common lines and moved to where they are drawn, and the polygon that they make up."""

from __future__ import annotations

import math
from collections import defaultdict
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.stages.regularisation.samples import RingSamples
from lidar_buildings.core.stages.regularisation.walls import (
    CENTRE_X,
    CENTRE_Y,
    N_SHAPE,
    RADIUS,
    Fit,
    WalledRing,
    about_direction,
    find_joint,
    fit_wall,
    foot_on,
    move_out,
    offset_of,
    swept,
)
from lidar_buildings.core.surfaces.ring_division import running_sums, scatter_of

#: Where walls cross, the ring is followed so far round about [smallest steps].
_MEND = 2.0


#: Width of an open arc's first and last chord, of which one end lies on the arc [widths of the others].
_LEAD = math.sqrt(0.75)


class _Line(NamedTuple):
    """Walls of one direction, and the sums of `running_sums` before and after their samples, (2, 6)."""

    sums: NDArray[np.float64]
    walls: list[int]

    def misfit(self, angle: float, fit: Fit) -> float:
        """Return the squared offsets from the line of least squares, with what its turn costs [m²]."""
        *_, xx, xy, yy = scatter_of(self.sums, 0, 1)
        along, across = about_direction(xx, xy, yy, angle)
        return float(xx + yy - along - across**2 / max(along + fit.stiffness, 1e-12))


def on_own_lines(samples: RingSamples, walled: WalledRing, fit: Fit) -> NDArray[np.float64]:
    """
    Return the shapes of walls, those on one line if that costs less than lines of their own.

    Walls of one direction with the building on the same side of them are joined, the nearest first, as long
    as the squared offsets rise by less than what a line of its own has to save. Beyond Sampath & Shan (2007),
    whose hierarchy ends with the walls.
    """
    shape, one, own = walled.shape.copy(), np.empty(N_SHAPE), (samples.points, samples.bears)
    for kind, lines in _lines_by_direction(samples, walled, fit):
        for line in _joined(lines, fit.angles[kind], fit):
            if len(line.walls) > 1:
                fit_wall(*own, line.sums, 0, 1, kind, fit.angles, fit.stiffness, one)
                shape[line.walls] = one
    return shape


def _lines_by_direction(samples: RingSamples, walled: WalledRing, fit: Fit) -> list[tuple[int, list[_Line]]]:
    """Return the lines of walls that share a direction, whose number leads, and a side, in order."""
    found: dict[tuple[int, bool], list[tuple[float, int, _Line]]] = defaultdict(list)
    points, sums = samples.points, running_sums(samples.points, samples.weights)
    for wall, (first, last, kind) in enumerate(zip(*(one.tolist() for one in walled[:3]), strict=True)):
        if kind < 0:
            continue
        c, s = np.cos(fit.angles[kind]), np.sin(fit.angles[kind])
        dx, dy = points[last % len(points)] - points[(first - 1) % len(points)]
        weight, x, y, xx, xy, yy = scatter_of(sums, first, last)
        x, y = foot_on(walled.shape[wall], x, y)
        own = np.zeros((2, 6))
        own[1] = np.array([0, 0, 0, xx, xy, yy]) + weight * np.array([1, x, y, x * x, x * y, y * y])
        found[kind, bool(dx * s > dy * c)].append((float(x * c + y * s), wall, _Line(own, [wall])))
    return [(kind, [line for *_, line in sorted(lines)]) for (kind, _), lines in found.items()]


def _joined(lines: list[_Line], angle: float, fit: Fit) -> list[_Line]:
    while len(lines) > 1:
        alone = [line.misfit(angle, fit) for line in lines]
        both = [_Line(one.sums + other.sums, one.walls + other.walls) for one, other in pairwise(lines)]
        costs = [line.misfit(angle, fit) for line in both] - np.add(alone[1:], alone[:-1])
        k = int(np.argmin(costs))
        if costs[k] >= fit.line_cost:
            break
        lines = [*lines[:k], both[k], *lines[k + 2 :]]
    return lines


def through_all_points(samples: RingSamples, walled: WalledRing, fit: Fit) -> WalledRing:
    """
    Move walls from the bearing points to where as many points on them lie outside as inside.

    Walls are found by the points that bear the ring, the outermost ones; the line through all points of a
    wall, as Sampath & Shan (2007) adjust it, lies inside. A median, other than least squares, stays where it
    is for a tree that touches the wall or a notch in it.
    """
    if samples.bears.all():  # as published, walls go through all of them
        return offset_outwards(samples, walled, fit, 0.0)
    rows = samples.is_on_wall, samples.rows, len(samples.points)
    offsets = _median_offsets(samples.ring, *rows, *walled[:2], walled.shape)
    return _drawn_anew(samples, walled, fit, offsets)


def offset_outwards(samples: RingSamples, walled: WalledRing, fit: Fit, distance: float) -> WalledRing:
    """Move all walls away from the building."""
    return _drawn_anew(samples, walled, fit, np.full(len(walled.first), distance))


def _drawn_anew(
    samples: RingSamples, walled: WalledRing, fit: Fit, distances: NDArray[np.float64]
) -> WalledRing:
    """Move each wall out by its distance [m], lay those in line on one line, and join them again."""
    moved = walled._replace(shape=_moved(samples.points, walled.first, walled.last, walled.shape, distances))
    shape = on_own_lines(samples, moved, fit)
    joints = _joints(samples.points, *walled[:2], shape, fit.min_step, fit.shortest)
    return walled._replace(shape=shape, joints=joints)


@kernel
def _median_offsets(ring, is_on_wall, rows, n_samples, first, last, shape):  # type: ignore[no-untyped-def]
    """Return how far outside each wall half of its points lie, negative inside [m]."""
    n = len(ring)
    offsets = np.zeros(len(first))
    for i in range(len(first)):
        row, end = rows[first[i]], rows[(last[i] - 1) % n_samples]
        before, behind = ring[(row - 1) % n], ring[(end + 1) % n]
        dx, dy = behind[0] - before[0], behind[1] - before[1]
        n_rows = (end - row) % n + 1
        if n_rows == 1 and 2 * (last[i] - first[i]) > n_samples:  # all round, and begun within an edge
            n_rows = n
        own = [ring[k % n] for k in range(row, row + n_rows) if is_on_wall[k % n]]
        if len(own) > 0:
            offsets[i] = np.median(np.array([offset_of(shape[i], dx, dy, one[0], one[1]) for one in own]))
    return offsets


@kernel
def _moved(points, first, last, shape, distances):  # type: ignore[no-untyped-def]
    n, shape = len(points), shape.copy()
    for i in range(len(first)):
        a, b = (first[i] - 1) % n, last[i] % n
        move_out(shape[i], points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], distances[i])
    return shape


@kernel
def _joints(points, first, last, shape, min_step, shortest):  # type: ignore[no-untyped-def]
    m = len(first)
    joints = np.zeros((m, 2, 2))
    for i in range(m if m > 1 else 0):
        find_joint(points, first, last, shape, i, (i + 1) % m, min_step, shortest, joints[i])
    return joints


def draw_ring(samples: RingSamples, walled: WalledRing, fit: Fit) -> tuple[NDArray[np.float64], int]:
    """
    Return the vertices of a ring, open, arcs in chords, and in how many places it follows its points instead.

    Walls cross where a ring is narrower than they are sure; no vertices if it cannot be drawn at all.
    """
    vertices = _drawn(samples.points, walled, fit)
    if len(vertices) < 3 or shapely.polygons(vertices).is_valid:
        return (vertices if len(vertices) >= 3 else np.zeros((0, 2))), 0
    return _mended(vertices, samples.ring, fit)


def _mended(
    vertices: NDArray[np.float64], ring: NDArray[np.float64], fit: Fit
) -> tuple[NDArray[np.float64], int]:
    """Put the ring's own course, simplified, in the place of walls where these cross each other."""
    traced = shapely.polygons(ring)
    pieces = shapely.get_parts(shapely.line_merge(shapely.node(shapely.linearrings(vertices))))
    faces = shapely.get_parts(shapely.polygonize(pieces))
    if not len(faces) or not traced.is_valid:
        return np.zeros((0, 2)), 0
    # A face is inside where the ring goes round it counter-clockwise.
    rays = shapely.get_coordinates(shapely.point_on_surface(faces))[:, None] - vertices
    after = np.roll(rays, -1, axis=1)
    cross = rays[..., 0] * after[..., 1] - rays[..., 1] * after[..., 0]
    turns = np.arctan2(cross, (rays * after).sum(axis=2)).sum(axis=1) / (2.0 * math.pi)
    ends = shapely.get_point(pieces, [[0], [-1]]).ravel()
    places = shapely.union_all(shapely.buffer(ends, _MEND * fit.min_step))
    walls = shapely.union_all(faces[turns > 0.5])
    whole = shapely.union(shapely.difference(walls, places), shapely.intersection(traced, places))
    largest = max(shapely.get_parts(whole), key=lambda part: float(part.area))
    mended = shapely.simplify(shapely.orient_polygons(shapely.Polygon(largest.exterior)), fit.min_step)
    if shapely.symmetric_difference(mended, traced).area > fit.min_step * traced.length:
        return np.zeros((0, 2)), 0
    return shapely.get_coordinates(mended)[:-1], len(shapely.get_parts(places))


def arc_chords(
    shape: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64], fit: Fit
) -> NDArray[np.float64]:
    """
    Return the vertices between an arc's ends, which lie on it; all of a circle's where these are one.

    They lie outside by what chords lie inside: half as much as if they were on it. No chord is under a
    shortest wall.
    """
    radius = abs(float(shape[RADIUS]))
    error = min(fit.chord_error, radius / 3.0)
    widest = 2.0 * math.acos((radius - error) / (radius + error))
    is_open = bool((start != end).any())
    sweep = float(swept(shape, start, end)) if is_open else 2.0 * math.pi
    lead = _LEAD if is_open else 1.0
    n_chords = max(math.ceil(sweep / widest + 2.0 - 2.0 * lead), 2)
    shortest = fit.shortest / (2.0 * radius)
    while n_chords > 2 and math.sin(0.5 * lead * sweep / (n_chords - 2.0 + 2.0 * lead)) < shortest:
        n_chords -= 1
    width = sweep / (n_chords - 2.0 + 2.0 * lead)
    middle = shape[[CENTRE_X, CENTRE_Y]]
    first = math.atan2(*(start - middle)[::-1])
    turns = first + math.copysign(width, shape[RADIUS]) * (lead + np.arange(n_chords - is_open))
    out = 2.0 * radius / (1.0 + max(math.cos(0.5 * width), 0.5))
    return np.asarray(middle + out * np.column_stack([np.cos(turns), np.sin(turns)]))


def _drawn(points: NDArray[np.float64], walled: WalledRing, fit: Fit) -> NDArray[np.float64]:
    m = len(walled.first)
    if m == 1:  # the whole ring is one circle
        start = np.array(foot_on(walled.shape[0], *points[walled.first[0] % len(points)]))
        return arc_chords(walled.shape[0], start, start, fit)
    path: list[NDArray[np.float64]] = []
    for i in range(m):
        start, end = walled.joints[i - 1, 1], walled.joints[i, 0]
        path.append(start)
        if walled.shape[i, RADIUS] != 0:
            path.extend(arc_chords(walled.shape[i], start, end, fit))
        path.append(end)
    corners = np.array(path).reshape(-1, 2)
    return corners[(corners != np.roll(corners, -1, axis=0)).any(axis=1)]
