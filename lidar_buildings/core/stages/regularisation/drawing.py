"""A walled ring drawn as a polygon: corners, the chords of its arcs, and what to do where walls cross."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.stages.regularisation.assembly import Fit, WalledRing
from lidar_buildings.core.stages.regularisation.joints import swept
from lidar_buildings.core.stages.regularisation.walls import CENTRE_X, CENTRE_Y, RADIUS, foot_on

#: How a wall is drawn: its line or arc, the chord from its first to its last sample, or all its samples.
_FITTED, _CHORD, _ALL_SAMPLES = 0, 1, 2
#: No wall: the step between two walls.
STEP = -1


class DrawnRing(NamedTuple):
    """A polygon's ring."""

    #: Open; without rows where no simple ring was found [m], shape (n_vertices, 2).
    vertices: NDArray[np.float64]
    #: The wall that the edge from each vertex to the next belongs to, `STEP` if none, shape (n_vertices,).
    wall: NDArray[np.int64]
    n_traced: int  #: number of walls that are drawn through their samples because fitted ones cross


def draw_ring(points: NDArray[np.float64], walled: WalledRing, fit: Fit) -> DrawnRing:
    """
    Draw a ring, arcs in chords; where walls cross, draw them closer to their samples, as far as it takes.
    """
    m = len(walled.first)
    detail = np.zeros(m, dtype=np.int64)
    while m:
        vertices, wall = _drawn(points, walled, fit, detail)
        if len(vertices) >= 3 and shapely.polygons(vertices).is_valid:
            return DrawnRing(vertices, wall, int(np.count_nonzero(detail)))
        crossing = _crossing_edges(vertices)
        involved = np.unique(np.concatenate([wall[crossing], wall[crossing - 1]]))
        finer = detail.copy()
        finer[involved[involved >= 0]] += 1
        np.minimum(finer, _ALL_SAMPLES, out=finer)
        if np.array_equal(finer, detail):
            break
        detail = finer
    return DrawnRing(np.zeros((0, 2)), np.zeros(0, dtype=np.int64), 0)


def arc_chords(
    shape: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64], fit: Fit
) -> NDArray[np.float64]:
    """Return the vertices between an arc's ends: equal chords within an error, none under a shortest wall."""
    radius = abs(float(shape[RADIUS]))
    sweep = float(swept(shape, start, end)) or 2.0 * math.pi
    widest = 2.0 * math.acos(max(1.0 - fit.chord_error / radius, 0.5))
    n_chords = max(math.ceil(sweep / widest), 2)
    while n_chords > 2 and 2.0 * radius * math.sin(0.5 * sweep / n_chords) < fit.shortest:
        n_chords -= 1
    middle = shape[[CENTRE_X, CENTRE_Y]]
    first = math.atan2(*(start - middle)[::-1])
    turns = first + math.copysign(sweep, shape[RADIUS]) * np.arange(1, n_chords) / n_chords
    return np.asarray(middle + radius * np.column_stack([np.cos(turns), np.sin(turns)]))


def _drawn(
    points: NDArray[np.float64], walled: WalledRing, fit: Fit, detail: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return all vertices in order and the wall of the edge that starts at each."""
    m = len(walled.first)
    if m == 1:
        return _whole_circle(points, walled, fit)
    vertices: list[NDArray[np.float64]] = []
    owners: list[int] = []
    for i in range(m):
        start, end = _ends(points, walled, detail, i)
        if detail[i] == _FITTED:
            path = [start]
            if walled.shape[i, RADIUS] != 0:
                path.extend(arc_chords(walled.shape[i], start, end, fit))
        else:
            rows = np.arange(walled.first[i], walled.last[i]) % len(points)
            path = list(points[rows[:: max(len(rows) - 1, 1)] if detail[i] == _CHORD else rows])
        if detail[i] == _FITTED and not np.array_equal(start, end):
            path.append(end)
        vertices.extend(path)
        owners.extend([i] * (len(path) - 1) + [STEP])
    return _without_repeats(np.array(vertices).reshape(-1, 2), np.array(owners, dtype=np.int64))


def _ends(
    points: NDArray[np.float64], walled: WalledRing, detail: NDArray[np.int64], i: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Return where a fitted wall begins and ends: at its joints, or beside a neighbour that is drawn as traced.
    """
    m, n = len(walled.first), len(points)
    before, behind = (i - 1) % m, (i + 1) % m
    start, end = walled.joints[before, 1], walled.joints[i, 0]
    if detail[before]:
        turn = 0.5 * (points[(walled.last[before] - 1) % n] + points[walled.first[i] % n])
        start = np.array(foot_on(walled.shape[i], *turn))
    if detail[behind]:
        turn = 0.5 * (points[(walled.last[i] - 1) % n] + points[walled.first[behind] % n])
        end = np.array(foot_on(walled.shape[i], *turn))
    return start, end


def _whole_circle(
    points: NDArray[np.float64], walled: WalledRing, fit: Fit
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Draw a ring that is one circle."""
    start = np.array(foot_on(walled.shape[0], *points[walled.first[0] % len(points)]))
    vertices = np.vstack([start, arc_chords(walled.shape[0], start, start, fit)])
    return vertices, np.zeros(len(vertices), dtype=np.int64)


def _without_repeats(
    vertices: NDArray[np.float64], owners: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Leave out vertices that are followed by the same one, and with them the edges of no length."""
    if not len(vertices):
        return vertices, owners
    goes_on = (vertices != np.roll(vertices, -1, axis=0)).any(axis=1)
    return vertices[goes_on], owners[goes_on]


def _crossing_edges(vertices: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the edges of a ring that meet another than their neighbours."""
    n = len(vertices)
    if n < 4:
        return np.arange(n)
    edges = shapely.linestrings(np.stack([vertices, np.roll(vertices, -1, axis=0)], axis=1))
    one, other = shapely.STRtree(edges).query(edges, predicate="intersects")
    apart = (one - other) % n
    crossing = np.unique(one[(apart > 1) & (apart < n - 1)])
    return crossing if len(crossing) else np.arange(n)
