"""Facing walls of different buildings, laid on one line between them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.outline import ring_walls
from lidar_buildings.core.neighbours.union_find import sets_of_pairs

#: Walls facing each other under a larger angle are no common wall.
MAX_ANGLE_DEG = 15.0
#: Walls share a line if they lie side by side over this many gaps.
MIN_OVERLAP_GAPS = 1.0
#: Walls so near each other are one already [m].
SAME = 2e-3
#: Chords of one arc have the same length, but for this share, and the same turn from one to the next, but for
#: this angle; a turn is at least and at most so large [deg].
SAME_CHORD, SAME_TURN_DEG, LEAST_TURN_DEG, LARGEST_TURN_DEG = 0.02, 1.0, 1.0, 60.0
#: Lines that meet under a smaller angle give no corner: the one that was there is kept.
MIN_CORNER_DEG = 20.0


class Walls(NamedTuple):
    """The edges of all rings of all buildings."""

    #: With the building on the left [m], shape (n_walls, 2).
    start: NDArray[np.float64]
    end: NDArray[np.float64]
    building: NDArray[np.int64]  #: whose they are, shape (n_walls,)
    before: NDArray[np.int64]  #: the wall that ends where each starts, shape (n_walls,)

    @property
    def length(self) -> NDArray[np.float64]:
        """[m]."""
        return np.hypot(*(self.end - self.start).T)


class Lines(NamedTuple):
    """Lines through a point along a unit vector, one for each wall."""

    #: [m], shape (n_walls, 2).
    point: NDArray[np.float64]
    along: NDArray[np.float64]
    #: Walls of one group have the same line; −1 where a wall keeps its own, shape (n_walls,).
    group: NDArray[np.int64]

    def foot(self, wall: int, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the place on a wall's line that is nearest."""
        along = self.along[wall]
        return np.asarray(self.point[wall] + along * ((place - self.point[wall]) @ along))


def on_common_lines(polygons: NDArray[np.object_], gaps: NDArray[np.float64]) -> NDArray[np.object_]:
    """
    Lay walls that face another building's wall on a common line; the others keep theirs.

    Polygons are as normalised, exteriors clockwise, or all the other way round; `gaps` is how far walls of
    each may be from those of others [m]. Not valid where walls of a building came to cross each other.
    """
    rings, ring_of = shapely.get_rings(polygons, return_index=True)
    walls = _walls_of(rings, ring_of)
    pairs, apart = _facing(walls, gaps)
    # An arc keeps its shape: what is between it and its neighbour goes to one of them as a whole.
    is_straight = ~_is_chord(walls)[pairs].any(axis=1)
    pairs, apart = pairs[is_straight], apart[is_straight]
    if apart.max(initial=0.0) <= SAME:
        return polygons
    lines = _common(walls, pairs, apart, gaps)
    parts: list[list[shapely.LinearRing]] = [[] for _ in polygons]
    first = 0
    for ring, building in zip(rings, ring_of, strict=True):
        n = shapely.get_num_coordinates(ring) - 1
        corners = [corner for wall in range(first, first + n) for corner in _corners(walls, lines, wall)]
        parts[building].append(shapely.LinearRing(corners) if len(corners) >= 3 else shapely.LinearRing())
        first += n
    return np.array([shapely.Polygon(own[0], own[1:]) for own in parts], dtype=object)


def _walls_of(rings: NDArray[np.object_], ring_of: NDArray[np.int64]) -> Walls:
    """Return the edges of closed rings."""
    sizes = shapely.get_num_coordinates(rings) - 1
    ends = ring_walls([shapely.get_coordinates(ring)[:-1] for ring in rings])
    first = np.cumsum(sizes) - sizes
    before = np.arange(len(ends)) - 1
    before[first] = first + sizes - 1
    return Walls(ends[:, 0], ends[:, 1], np.repeat(ring_of, sizes), before)


def _is_chord(walls: Walls) -> NDArray[np.bool_]:
    """
    Tell which walls are chords of an arc: one of three or more in a row that are equal and turn equally.
    """
    after = np.empty_like(walls.before)
    after[walls.before] = np.arange(len(after))
    along = walls.end - walls.start
    length, heading = walls.length, np.arctan2(along[:, 1], along[:, 0])
    turn = np.rad2deg((heading[after] - heading + np.pi) % (2.0 * np.pi) - np.pi)
    bends = (np.abs(length[after] - length) <= SAME_CHORD * length) & (np.abs(turn) >= LEAST_TURN_DEG)
    bends &= np.abs(turn) <= LARGEST_TURN_DEG
    goes_on = bends & bends[after] & (np.abs(turn[after] - turn) <= SAME_TURN_DEG)
    is_chord = goes_on.copy()
    is_chord[after[goes_on]] = True
    is_chord[after[after[goes_on]]] = True
    return is_chord


def _facing(walls: Walls, gaps: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """
    Return pairs of walls of different buildings that run side by side, and how far apart, up to the gap.
    """
    segments = shapely.linestrings(np.stack([walls.start, walls.end], axis=1))
    found = shapely.STRtree(segments).query(segments, predicate="dwithin", distance=gaps.max())
    a, b = found[:, found[0] < found[1]]
    length = walls.length
    swapped = length[a] < length[b]
    a, b = np.where(swapped, b, a), np.where(swapped, a, b)
    gap = (gaps[walls.building[a]] + gaps[walls.building[b]]) / 2.0
    along = (walls.end[a] - walls.start[a]) / np.maximum(length[a], 1e-12)[:, None]
    other = walls.end[b] - walls.start[b]
    cosine = (along * other).sum(axis=1) / np.maximum(length[b], 1e-12)
    chosen = (walls.building[a] != walls.building[b]) & (cosine <= -math.cos(math.radians(MAX_ANGLE_DEG)))
    a, b, gap, along = a[chosen], b[chosen], gap[chosen], along[chosen]
    across = np.column_stack([-along[:, 1], along[:, 0]])
    ends = np.stack([walls.end[b], walls.start[b]], axis=1) - walls.start[a][:, None]
    place, offset = (ends * along[:, None]).sum(axis=2), (ends * across[:, None]).sum(axis=2)
    low, high = np.maximum(place[:, 0], 0.0), np.minimum(place[:, 1], length[a])
    slope = (offset[:, 1] - offset[:, 0]) / np.maximum(place[:, 1] - place[:, 0], 1e-12)
    apart = np.abs(offset[:, :1] + slope[:, None] * (np.stack([low, high], axis=1) - place[:, :1])).max(
        axis=1
    )
    beside = (high - low >= np.maximum(MIN_OVERLAP_GAPS * gap, 1e-9)) & (apart <= gap)
    return np.column_stack([a, b])[beside], apart[beside]


def _common(
    walls: Walls, pairs: NDArray[np.int64], apart: NDArray[np.float64], gaps: NDArray[np.float64]
) -> Lines:
    """Return the line of each wall: of its group if it faces others, else its own."""
    n = len(walls.building)
    label = sets_of_pairs(n, pairs[:, 0], pairs[:, 1])
    along = (walls.end - walls.start) / np.maximum(walls.length, 1e-12)[:, None]
    lines = Lines(walls.start.copy(), along, np.full(n, -1))
    for group in np.unique(label[pairs[apart > SAME, 0]]):
        members = np.flatnonzero(label == group)
        while len(members) > 1:
            point, direction = _fitted(walls, members)
            across = np.array([-direction[1], direction[0]])
            away = np.abs((np.stack([walls.start, walls.end])[:, members] - point) @ across).max(axis=0)
            excess = away - gaps[walls.building[members]]
            if excess.max() <= 0.0:
                lines.point[members], lines.along[members], lines.group[members] = point, direction, group
                break
            members = np.delete(members, np.argmax(excess))
    return lines


def _fitted(walls: Walls, members: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fit a line to all points of walls by orthogonal least squares."""
    start, end, weight = walls.start[members], walls.end[members], walls.length[members]
    middle, half = (start + end) / 2.0, (end - start) / 2.0
    point = weight @ middle / weight.sum()
    spread = (middle - point).T @ ((middle - point) * weight[:, None]) + half.T @ (
        half * weight[:, None]
    ) / 3.0
    return point, np.linalg.eigh(spread)[1][:, 1]


def _corners(walls: Walls, lines: Lines, wall: int) -> list[NDArray[np.float64]]:
    """Return the vertices between a wall and the one before it."""
    before, corner = walls.before[wall], walls.start[wall]
    groups = lines.group[before], lines.group[wall]
    if groups == (-1, -1):
        return [corner]
    if groups[0] == groups[1]:
        return [lines.foot(wall, corner)]
    ahead, across = lines.along[before], np.array([-lines.along[wall][1], lines.along[wall][0]])
    sine = float(ahead @ across)
    if abs(sine) >= math.sin(math.radians(MIN_CORNER_DEG)):
        return [lines.point[before] + ahead * ((lines.point[wall] - lines.point[before]) @ across / sine)]
    return [lines.foot(k, corner) for k, group in zip((before, wall), groups, strict=True) if group >= 0]
