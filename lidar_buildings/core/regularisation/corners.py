"""
From the walls of a ring to its corners.

"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.regularisation.division import FREE, Wall
from lidar_buildings.core.regularisation.lines import Line, free_line, weighted_line

#: Walls whose directions differ by less are parallel: they meet in a step, not in a corner [rad].
_PARALLEL = np.deg2rad(15.0)
#: A corner may lie this far from where the ring turns from one wall to the next [smallest steps].
_MAX_CORNER_SHIFT = 2.5
#: Finest way to draw a wall, see `_assembled`.
_ALL_POINTS = 2


@dataclass(frozen=True)
class Fit:
    """
    How lines are fitted to walls and which details are kept.

    Attributes
    ----------
    angles : ndarray of shape (n_directions,)
        Directions of the walls' normals [rad].
    weight : float
        Weight of these directions, in multiples of the wall's own points.
    min_step : float
        Smallest step or wall that is kept [m].

    """

    angles: NDArray[np.float64]
    weight: float
    min_step: float


@dataclass(frozen=True)
class _Fitted:
    """
    A wall with its line.

    """

    wall: Wall
    line: Line


def corners_of(ring: NDArray[np.float64], walls: list[Wall], fit: Fit) -> tuple[NDArray[np.float64], int]:
    """
    Return the ring whose edges are the walls' lines.

    Consecutive lines are intersected; parallel ones are joined by a perpendicular step, or made one where
    the step is too small. A wall that comes out too short, or the wrong way round, is dropped, the worst
    one first, until all are long enough. Walls that cross go through
    traced points instead.

    Parameters
    ----------
    ring : ndarray of shape (n_points, 2)
        Open, simple ring about the building's centre [m].
    walls : list of Wall
        In the ring's order.
    fit : Fit
        Directions and limits.

    Returns
    -------
    corners : ndarray of shape (n_corners, 2)
        Without rows where no ring is left, else a simple ring.
    n_traced : int
        Number of walls that were left as traced.

    """
    fitted = [_Fitted(wall, _line(ring, wall, fit)) for wall in walls]
    while True:
        fitted = _merge_parallels(ring, fitted, fit)
        if len(fitted) < 2:
            return np.zeros((0, 2)), 0
        joints = [
            _joint(ring, one, other, fit) for one, other in zip(fitted, [*fitted[1:], fitted[0]], strict=True)
        ]
        lengths = [
            float((joints[i][0] - joints[i - 1][-1]) @ _travel(ring, fitted[i])) for i in range(len(fitted))
        ]
        shortest = int(np.argmin(lengths))
        if lengths[shortest] >= fit.min_step:
            return _without_crossings(ring, fitted, joints)
        del fitted[shortest]


def _without_crossings(
    ring: NDArray[np.float64], fitted: list[_Fitted], joints: list[NDArray[np.float64]]
) -> tuple[NDArray[np.float64], int]:
    """
    Return the corners, the walls that cross drawn closer to their traced points, as far as it takes.

    """
    detail = [0] * len(fitted)
    while True:
        corners, owners = _assembled(ring, fitted, joints, detail)
        if len(corners) >= 3 and shapely.Polygon(corners).is_valid:
            return corners, sum(level > 0 for level in detail)
        crossing = {wall for edge in _crossing_edges(corners) for wall in owners[edge]}
        finer = [min(level + (i in crossing), _ALL_POINTS) for i, level in enumerate(detail)]
        if finer == detail:
            return np.zeros((0, 2)), 0
        detail = finer


def _assembled(
    ring: NDArray[np.float64], fitted: list[_Fitted], joints: list[NDArray[np.float64]], detail: list[int]
) -> tuple[NDArray[np.float64], list[tuple[int, ...]]]:
    """
    Return all corners in order, and to which walls the edge that starts at each belongs.

    `detail` tells of each wall whether its line is drawn (0), the chord from its first to its last point (1)
    or all its points (2).

    """
    corners: list[NDArray[np.float64]] = []
    owners: list[tuple[int, ...]] = []
    for i in range(len(fitted)):
        k = (i + 1) % len(fitted)
        if detail[i]:
            rows = fitted[i].wall.rows(len(ring))
            rows = rows if detail[i] == _ALL_POINTS else rows[:: max(len(rows) - 1, 1)]
            corners.extend(ring[rows])
            owners.extend([(i,)] * len(rows))
        if not detail[i] and not detail[k]:
            corners.extend(joints[i])
            owners.extend([(i, k), (k,)][-len(joints[i]) :])
        elif not (detail[i] and detail[k]):
            turn = _turning_point(ring, fitted[i], fitted[k])
            corners.append(fitted[k if detail[i] else i].line.foot(turn))
            owners.append((i, k))
    return np.array(corners).reshape(-1, 2), owners


def _crossing_edges(corners: NDArray[np.float64]) -> NDArray[np.int64]:
    """
    Return the edges of a ring that meet another than their neighbours.

    """
    n = len(corners)
    if n < 4:
        return np.arange(n)
    edges = shapely.linestrings(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
    one, other = shapely.STRtree(edges).query(edges, predicate="intersects")
    apart = (one - other) % n
    return np.unique(one[(apart > 1) & (apart < n - 1)])


def _merge_parallels(ring: NDArray[np.float64], fitted: list[_Fitted], fit: Fit) -> list[_Fitted]:
    """
    Make consecutive parallel walls one where the step between them is too small to keep.

    """
    i = 0
    while len(fitted) > 1 and i < len(fitted):
        one, other = fitted[i], fitted[(i + 1) % len(fitted)]
        if _is_continued(ring, one, other, fit):
            merged = _merged(ring, one, other, fit)
            fitted = (
                [*fitted[:i], merged, *fitted[i + 2 :]] if i + 1 < len(fitted) else [*fitted[1:-1], merged]
            )
            i = max(i - 1, 0)
        else:
            i += 1
    return fitted


def _is_continued(ring: NDArray[np.float64], one: _Fitted, other: _Fitted, fit: Fit) -> bool:
    """
    Whether the next wall goes on in the same direction with hardly a step.

    """
    if _between(one.line, other.line) > _PARALLEL or _travel(ring, one) @ _travel(ring, other) <= 0:
        return False
    turn = _turning_point(ring, one, other)
    return float(np.hypot(*(one.line.foot(turn) - other.line.foot(turn)))) < fit.min_step


def _merged(ring: NDArray[np.float64], one: _Fitted, other: _Fitted, fit: Fit) -> _Fitted:
    """
    Return two walls as one that has the direction of the longer.

    """
    longer = one if _span(one.wall) >= _span(other.wall) else other
    last = other.wall.last
    while last <= one.wall.first:
        last += len(ring)
    wall = replace(longer.wall, first=one.wall.first, last=last)
    return _Fitted(wall, _line(ring, wall, fit))


def _line(ring: NDArray[np.float64], wall: Wall, fit: Fit) -> Line:
    """
    Fit a wall's line.

    """
    points = ring[wall.rows(len(ring))]
    if wall.direction == FREE:
        return free_line(points)
    return weighted_line(points, float(fit.angles[wall.direction]), fit.weight)


def _joint(ring: NDArray[np.float64], one: _Fitted, other: _Fitted, fit: Fit) -> NDArray[np.float64]:
    """
    Return the corner between two walls, or the two ends of the step between them.

    """
    turn = _turning_point(ring, one, other)
    if _between(one.line, other.line) > _PARALLEL:
        corner = one.line.meeting(other.line)
        if corner is not None and np.hypot(*(corner - turn)) <= _MAX_CORNER_SHIFT * fit.min_step:
            return corner[None]
    return np.array([one.line.foot(turn), other.line.foot(turn)])


def _turning_point(ring: NDArray[np.float64], one: _Fitted, other: _Fitted) -> NDArray[np.float64]:
    """
    Return the middle between the last point of a wall and the first of the next.

    """
    return 0.5 * (ring[(one.wall.last - 1) % len(ring)] + ring[other.wall.first % len(ring)])


def _travel(ring: NDArray[np.float64], fitted: _Fitted) -> NDArray[np.float64]:
    """
    Return the unit vector along a wall's line in the ring's sense.

    """
    along = np.array([-np.sin(fitted.line.angle), np.cos(fitted.line.angle)])
    chord = ring[fitted.wall.last % len(ring)] - ring[(fitted.wall.first - 1) % len(ring)]
    return along if chord @ along >= 0 else -along


def _between(one: Line, other: Line) -> float:
    """
    Return the angle between two lines, 0 to π/2 [rad].

    """
    difference = (one.angle - other.angle) % np.pi
    return float(min(difference, np.pi - difference))


def _span(wall: Wall) -> int:
    """
    Return the number of a wall's points.

    """
    return wall.last - wall.first
