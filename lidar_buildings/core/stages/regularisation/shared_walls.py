"""
Walls shared by touching buildings: one line for both, no gap between them and no overlap.

Facing walls are laid on one line; what is then left between the buildings is a face of the planar
subdivision, and belongs to one building or to none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.core.solids.planar_subdivision import divide_plane, face_owners, straightened_rings

#: Walls facing each other under a larger angle are no common wall.
MAX_ANGLE_DEG = 15.0
#: Walls share a line if they lie side by side over this many gaps.
MIN_OVERLAP_GAPS = 1.0
#: Walls so near each other are one already [m].
SAME = 2e-3
#: Lines that meet under a smaller angle give no corner: the one that was there is kept.
MIN_CORNER_DEG = 20.0
#: Vertices of the arrangement lie on a grid of this side [m], which makes it exact; far below any noise.
GRID = 1e-3
#: Two buildings border on a place if they do so over this many gaps.
MIN_BORDER_GAPS = 0.5
#: Vertices that lie no farther than this from the line between their neighbours say nothing [grid cells].
MAX_BEND = 1.5
#: A building keeps its outline if it would lose more than this share of its area, or gain more than that and
#: more than half the gap along all its walls.
MAX_CHANGE = 0.2


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
    sizes = shapely.get_num_coordinates(rings) - 1
    ends = ring_walls([shapely.get_coordinates(ring)[:-1] for ring in rings])
    first = np.cumsum(sizes) - sizes
    before = np.arange(len(ends)) - 1
    before[first] = first + sizes - 1
    return Walls(ends[:, 0], ends[:, 1], np.repeat(ring_of, sizes), before)


def _facing(walls: Walls, gaps: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return pairs of walls of two buildings that run side by side, and how far apart, up to the gap."""
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
    start, end, weight = walls.start[members], walls.end[members], walls.length[members]
    middle, half = (start + end) / 2.0, (end - start) / 2.0
    point = weight @ middle / weight.sum()
    spread = (middle - point).T @ ((middle - point) * weight[:, None]) + half.T @ (
        half * weight[:, None]
    ) / 3.0
    return point, np.linalg.eigh(spread)[1][:, 1]


def _corners(walls: Walls, lines: Lines, wall: int) -> list[NDArray[np.float64]]:
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


def partitioned(
    polygons: NDArray[np.object_],
    traced: NDArray[np.object_],
    gaps: NDArray[np.float64],
    kept: NDArray[np.float64],
) -> NDArray[np.object_]:
    """
    Share out gaps and overlaps between buildings, and insert the vertices where one ends on another's wall.

    `gaps` is how wide gaps beside each may be to be filled [m]; vertices `kept` stay even where no wall
    bends. Touching buildings have the same vertices along their common walls; None for one that is nothing
    any more, or of several parts.
    """
    slots = _slots(polygons, gaps)
    rings = shapely.get_parts(shapely.boundary(np.concatenate([polygons, slots])))
    faces = divide_plane(rings, GRID)
    faces = faces[np.lexsort(shapely.bounds(faces).T)]
    area = shapely.area(polygons)
    # Of several buildings the one whose points a face is among has it, else the smallest.
    owner = face_owners(
        faces,
        polygons,
        lambda face, building, inside: (~shapely.contains(traced[building], inside[face]), area[building]),
    )
    _fill(faces, owner, gaps)
    return _merged(faces, owner, polygons, kept)


def _slots(polygons: NDArray[np.object_], gaps: NDArray[np.float64]) -> NDArray[np.object_]:
    """Return the places between two buildings too narrow to stay open, though open at one end."""
    reach = gaps.max() / 2.0
    if reach == 0.0:
        return np.zeros(0, dtype=object)
    filled = shapely.union_all(polygons)
    closed = shapely.buffer(shapely.buffer(filled, reach, join_style="mitre"), -reach, join_style="mitre")
    closed = shapely.make_valid(closed)  # GEOS lets mitred corners cross
    places = shapely.get_parts(shapely.difference(closed, filled))
    places = places[shapely.area(places) > GRID * reach]
    place, building = shapely.STRtree(polygons).query(places, predicate="dwithin", distance=GRID)
    beside = shapely.intersection(polygons[building], shapely.buffer(places[place], GRID))
    contact = shapely.area(beside) / GRID
    borders = contact >= MIN_BORDER_GAPS * gaps[building]
    n_borders = np.bincount(place[borders], minlength=len(places))
    widest = np.zeros(len(places))
    np.maximum.at(widest, place[borders], gaps[building[borders]])
    return places[(n_borders >= 2) & _narrow(places, widest)]


def _narrow(places: NDArray[np.object_], width: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray(shapely.is_empty(shapely.buffer(places, -(width / 2.0 + GRID), join_style="mitre")))


def _fill(faces: NDArray[np.object_], owner: NDArray[np.int64], gaps: NDArray[np.float64]) -> None:
    """Give narrow faces between two buildings to the one with the longer border, until nothing changes."""
    open_faces = np.flatnonzero(owner < 0)
    open_faces = open_faces[_narrow(faces[open_faces], np.full(len(open_faces), gaps.max()))]
    if len(open_faces) == 0:
        return
    which, other = shapely.STRtree(faces).query(faces[open_faces], predicate="intersects")
    which, other = which[open_faces[which] != other], other[open_faces[which] != other]
    rims = shapely.boundary(faces)
    border = shapely.length(shapely.intersection(rims[open_faces[which]], rims[other]))
    while True:
        given = 0
        for number, face in enumerate(open_faces):
            mine = (which == number) & (owner[other] >= 0)
            if owner[face] >= 0 or not mine.any():
                continue
            lengths = np.bincount(owner[other[mine]], border[mine], minlength=len(gaps))
            touching = np.flatnonzero(lengths > 0)
            if len(touching) > 1 and _narrow(faces[face : face + 1], gaps[touching].max(keepdims=True))[0]:
                owner[face] = np.argmax(lengths)
                given += 1
        if given == 0:
            return


def _merged(
    faces: NDArray[np.object_],
    owner: NDArray[np.int64],
    polygons: NDArray[np.object_],
    kept: NDArray[np.float64],
) -> NDArray[np.object_]:
    """Merge each building's faces, vertices as in the outlines; None if nothing or several parts."""
    merged = np.array(
        [shapely.coverage_union_all(faces[owner == building]) for building in range(len(polygons))],
        dtype=object,
    )
    is_one = shapely.get_type_id(merged) == shapely.GeometryType.POLYGON
    is_one &= ~shapely.is_empty(merged)
    # The coordinates of the outlines' vertices by place on the grid; of several the least.
    places = shapely.get_coordinates(polygons)
    places = places[np.lexsort(places.T[::-1])][::-1]
    on_grid = np.rint(places / GRID).astype(np.int64).tolist()
    known = {(x, y): (u, v) for (x, y), (u, v) in zip(on_grid, places.tolist(), strict=True)}
    steps = shapely.transform(merged[is_one], lambda xy: np.rint(xy / GRID))
    rings = straightened_rings(steps, np.rint(kept / GRID).astype(np.int64), MAX_BEND)
    result = np.full(len(polygons), None, dtype=object)
    for building, own in zip(np.flatnonzero(is_one), rings, strict=True):
        parts = [[known.get((x, y), (x * GRID, y * GRID)) for x, y in ring.tolist()] for ring in own]
        result[building] = shapely.Polygon(parts[0], parts[1:]) if parts else None
    return result


@dataclass(frozen=True, eq=False)
class SharedWalls:
    """The outlines of a block, walls shared."""

    outlines: tuple[Outline, ...]  #: in the order they were given
    #: For each, why it stayed as it was although it touches others; empty where there is nothing to say.
    reasons: tuple[str, ...]


def share_walls(
    outlines: Sequence[Outline], traced: Sequence[Outline], max_gap: Sequence[float] | float
) -> SharedWalls:
    """
    Give neighbours the same wall, vertex for vertex, where they are apart or overlap by a little.

    Walls of different buildings that face each other are laid on one line between them, which the longer one
    has the greater say in; corners follow along the next walls. What is then left of gaps and overlaps
    is a face of the arrangement of all outlines, and goes to one of its neighbours as a whole; corners that
    end on a neighbour's wall become vertices of it.

    The rings through the points, `traced`, decide whose a place is that several outlines cover. `max_gap` is
    how far walls may be apart, or overlap, to be one, for all buildings or for each; the mean of the two
    counts [m]. Outlines that touch no other are the same objects as given. So is a building that sharing
    would make invalid, part, or change by much more than its half of the gaps: then the others share without
    it. Neither the order of the buildings nor the first vertex of a ring matters. Vertices closer than 1 mm
    become one. Shared vertices are equal numbers, so that they stay equal when rounded to float32.
    """
    given, hints = (
        shapely.normalize(np.array([one.polygon for one in side], dtype=object))
        for side in (outlines, traced)
    )
    # Whatever the order in which buildings come.
    forms = shapely.to_wkb(given).tolist()
    order = np.array(sorted(range(len(given)), key=forms.__getitem__), dtype=np.int64)
    polygons, hints = given[order], hints[order]
    gaps = np.broadcast_to(np.asarray(max_gap, dtype=np.float64), len(outlines))[order]
    reasons = np.full(len(order), "", dtype=object)
    reasons[~(shapely.is_valid(polygons) & ~shapely.is_empty(polygons))] = "the outline is not valid"
    while True:
        members = np.flatnonzero(reasons == "")
        members = members[_touches(polygons[members], gaps[members])]
        shared = _shared(polygons[members], hints[members], gaps[members])
        faults = np.array(list(map(_fault, polygons[members], shared, gaps[members])), dtype=object)
        if (faults == "").all():
            break
        reasons[members] = faults
    result = list(outlines)
    for member, polygon in zip(members, shapely.normalize(shared), strict=True):
        if polygon != polygons[member]:
            result[order[member]] = Outline.of(polygon)
    return SharedWalls(tuple(result), tuple(reasons[np.argsort(order)]))


def _shared(
    polygons: NDArray[np.object_], hints: NDArray[np.object_], gaps: NDArray[np.float64]
) -> NDArray[np.object_]:
    """Return buildings that share their walls, None where one would be nothing or of several parts."""
    if len(polygons) == 0:
        return polygons
    laid = on_common_lines(polygons, gaps)
    is_laid = shapely.is_valid(laid)
    is_laid &= np.abs(shapely.area(laid) - shapely.area(polygons)) <= _most_gained(polygons, gaps)
    laid = np.where(is_laid, laid, polygons)
    return partitioned(laid, hints, gaps, shapely.get_coordinates(polygons))


def _touches(polygons: NDArray[np.object_], gaps: NDArray[np.float64]) -> NDArray[np.bool_]:
    touches = np.zeros(len(polygons), dtype=bool)
    if len(polygons) > 1:
        near = shapely.STRtree(polygons).query(polygons, predicate="dwithin", distance=gaps.max())
        first, second = near[:, near[0] < near[1]]
        is_near = shapely.distance(polygons[first], polygons[second]) <= (gaps[first] + gaps[second]) / 2.0
        touches[first[is_near]] = touches[second[is_near]] = True
    return touches


def _most_gained(
    polygons: NDArray[np.object_] | shapely.Polygon, gaps: NDArray[np.float64] | float
) -> NDArray[np.float64]:
    return np.maximum(MAX_CHANGE * shapely.area(polygons), 0.5 * gaps * shapely.length(polygons))


def _fault(before: shapely.Polygon, after: shapely.Polygon | None, gap: float) -> str:
    if after is None:
        return "sharing walls would leave nothing of it or several parts"
    if not after.is_valid:
        return "sharing walls would make it invalid"
    lost, gained = before.difference(after).area, after.difference(before).area
    if lost > MAX_CHANGE * before.area or gained > float(_most_gained(before, gap)):
        lost, gained = lost / before.area, gained / before.area
        return f"sharing walls would take {lost:.0%} of its area and add {gained:.0%}"
    return ""
