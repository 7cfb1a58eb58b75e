"""The stage: façades in points that were seen from the street."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.model.point_array import checked_column, checked_points
from lidar_buildings.core.neighbours.cell_grid import lowest_per_cell, sort_by_cell
from lidar_buildings.core.stages.facades.config import FacadesConfig
from lidar_buildings.core.stages.facades.facade import ARC, STRAIGHT, Facade
from lidar_buildings.core.stages.facades.judging import (
    LONE_LENGTH,
    confidence,
    faced,
    stretches,
    tall_stretches,
)
from lidar_buildings.core.stages.facades.layers import in_sight, without_layers
from lidar_buildings.core.stages.facades.pieces import VOXEL, pieces_of, upright_points
from lidar_buildings.core.stages.facades.walls import (
    BIN,
    PLACE_CELL,
    PointsAbout,
    Scenery,
    Wall,
    joined_walls,
)

Floats = NDArray[np.float64]

#: What is nearer to the ground says nothing: kerbs, and ground itself [m].
MIN_HEIGHT = 0.15
#: Shares of a wall's points below its bottom and its top: there are strays.
_ENDS = (0.005, 0.995)
#: Ends this near one another touch [m].
TOUCH = 1.0
#: Ends of walls are drawn to a corner that lies within this of both [m].
REACH = 0.5
#: Walls that meet at a flatter angle have no corner of their own: sine of 15°.
MIN_SINE = 0.26


def find_facades(
    points: ArrayLike,
    height_above_ground: ArrayLike,
    is_ground: ArrayLike,
    config: FacadesConfig | None = None,
    *,
    is_core: ArrayLike | None = None,
) -> tuple[Facade, ...]:
    """
    Find the walls of buildings that a scanner on the street saw, at whatever height.

    Points on upright surfaces are linked to smooth patches, which are divided into straight lines and arcs in
    plan; pieces of one line are joined and fitted to all points near them by least squares with Tukey's
    biweight, so that windows and what is seen through them do not pull. A wall is told from fences, hedges
    and vehicles by the height at which it ends and by what was seen behind and over it, and from a room by
    the open ground that has it in sight past plainer walls.

    - `points`, shape (n_points, 3): All points that were seen from the street, in any order [m].
    - `height_above_ground`, shape (n_points,): [m].
    - `is_ground`, shape (n_points,): True for points on the terrain.
    - `config`, optional: The stage's parameters.
    - `is_core`, shape (n_points,), optional: What the other points show is returned as no core.

    Returned by the place of their first vertex, from west to east; each has its front on its left. ValueError
    if an array has another shape, or a number is not finite. The order of the points does not matter.
    """
    config = config or FacadesConfig()
    points = checked_points(points)
    height = checked_column("height_above_ground", height_above_ground, len(points), np.float64)
    on_ground = checked_column("is_ground", is_ground, len(points), np.bool_)
    core = np.ones(len(points), dtype=bool)
    if is_core is not None:
        core = checked_column("is_core", is_core, len(points), np.bool_)
    rows = np.flatnonzero(~on_ground & (height >= MIN_HEIGHT))
    if not len(rows):
        return ()
    ordered = sort_by_cell(points.take(rows, axis=0), VOXEL)
    rows = rows[ordered.rows]
    around = PointsAbout(ordered.points, height[rows], core[rows])
    pieces = pieces_of(upright_points(ordered.points))
    scenery = _scenery(points, height, on_ground, rows)
    found = []
    for wall in joined_walls(pieces, around, config.max_gap):
        for tall in tall_stretches(wall, around, config.min_seen_height, config.max_gap):
            one = faced(tall, scenery)
            sure = confidence(one, around, scenery)
            if sure >= config.min_confidence and one.length >= config.min_length:
                found.append(one)
    found = in_sight(found, around, scenery)
    walls = [one for one in without_layers(found, around, config.max_gap) if one.length >= config.min_length]
    lines = [one.curve.chords(one.first, one.last) for one in walls]
    of_line = Counter(tuple(one.curve.origin) for one in walls)
    alone = ~touching(lines, TOUCH) & np.array([of_line[tuple(one.curve.origin)] == 1 for one in walls], bool)
    facades = []
    for wall, foot, is_alone in zip(walls, join_corners(lines), alone, strict=True):
        sure = confidence(wall, around, scenery)
        if is_alone:
            sure *= min(1.0, wall.length / LONE_LENGTH)
        if sure >= config.min_confidence:
            for part, line, is_own in _parts(wall, foot, around, config.max_gap):
                facades.append(replace(_facade(part, line, sure, around), is_core=is_own))
    return tuple(sorted(facades, key=lambda one: tuple(one.foot[0])))


def _scenery(
    points: Floats, height: Floats, on_ground: NDArray[np.bool_], others: NDArray[np.intp]
) -> Scenery:
    ground = points.take(np.flatnonzero(on_ground), axis=0)
    ground = ground[lowest_per_cell(ground, PLACE_CELL)] if len(ground) else ground
    return Scenery(ground, points.take(others, axis=0), height[others])


def _parts(
    wall: Wall, foot: Floats, around: PointsAbout, max_gap: float
) -> Iterator[tuple[Wall, Floats, bool]]:
    """Yield the stretches of a wall that core points show, or others, their foot lines, and which it is."""
    n = np.bincount(wall.bins, minlength=len(wall.is_seen))
    n_core = np.bincount(wall.bins[around.is_core[wall.rows]], minlength=len(wall.is_seen))
    if (n == n_core).all() or not n_core.any():
        yield wall, foot, bool(n_core.any())
        return
    for is_own in (True, False):
        rows = np.flatnonzero(wall.is_seen & ((2 * n_core > n) == is_own))
        for part in stretches(wall, rows, np.inf if is_own else max_gap):
            line = part.curve.chords(part.first, part.last)
            for end, is_same in ((0, part.first == wall.first), (-1, part.last == wall.last)):
                if is_same:
                    line[end] = foot[end]
            yield part, line, is_own


def _facade(wall: Wall, foot: Floats, sure: float, around: PointsAbout) -> Facade:
    z = around.points[wall.rows, 2]
    bottom, top = np.quantile(z, _ENDS).tolist()
    layers = max(1, int(np.ceil((top - bottom) / BIN)))
    cells = wall.bins * layers + np.clip(((z - bottom) / BIN).astype(np.intp), 0, layers - 1)
    return Facade(
        foot=foot,
        bottom=bottom,
        top=top,
        is_seen=wall.is_seen,
        coverage=len(np.unique(cells)) / (layers * len(wall.is_seen)),
        sigma=wall.sigma,
        n_points=len(wall.rows),
        confidence=sure,
        kind=ARC if wall.curve.bend else STRAIGHT,
    )


def join_corners(lines: Sequence[Floats]) -> list[Floats]:
    """Return polylines, shape (n ≥ 2, 2) each, whose ends are drawn to where they meet others' ends."""
    joined = [line.copy() for line in lines]
    ends = [(k, at) for k in range(len(lines)) for at in (0, -1)]
    if len(ends) < 4:
        return joined
    places = np.array([lines[k][at] for k, at in ends])
    pairs = cKDTree(places).query_pairs(2.0 * REACH, output_type="ndarray")
    corners = []
    for i, j in pairs.tolist():
        (one, at), (other, there) = ends[i], ends[j]
        if one != other:
            corner = _corner(lines[one], at, lines[other], there)
            if corner is not None:
                reach = max(np.hypot(*(corner - places[i])), np.hypot(*(corner - places[j])))
                if reach <= REACH:
                    corners.append((float(reach), i, j, corner))
    taken: set[int] = set()
    for _, i, j, corner in sorted(corners, key=lambda one: one[:3]):
        if not taken & {i, j}:
            taken |= {i, j}
            for k, at in (ends[i], ends[j]):
                joined[k][at] = corner
    return joined


def _corner(one: Floats, at: int, other: Floats, there: int) -> Floats | None:
    """Return where the lines of two ends meet, None if they hardly do."""
    (a, p), (b, q) = _ray(one, at), _ray(other, there)
    sine = p[0] * q[1] - p[1] * q[0]
    if abs(sine) < MIN_SINE:
        return None
    away = b - a
    return a + (away[0] * q[1] - away[1] * q[0]) / sine * p


def _ray(line: Floats, at: int) -> tuple[Floats, Floats]:
    """Return an end and the direction in which the line leaves it."""
    out = line[at] - line[1 if at == 0 else -2]
    return line[at], out / np.hypot(*out)


def touching(lines: Sequence[Floats], reach: float) -> NDArray[np.bool_]:
    """Tell which lines have an end within reach of another line's end [m]."""
    is_touching = np.zeros(len(lines), dtype=bool)
    ends = np.array([line[at] for line in lines for at in (0, -1)]).reshape(-1, 2)
    for i, j in cKDTree(ends).query_pairs(reach, output_type="ndarray").tolist() if len(ends) else ():
        if i // 2 != j // 2:
            is_touching[[i // 2, j // 2]] = True
    return is_touching
