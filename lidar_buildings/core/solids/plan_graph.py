"""
The plan of a roof as a planar graph, from pieces that need not match: which piece lies beside each edge.

Vertices are whole grid steps (millimetres), so that equal places are equal numbers and nothing is rounded
twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.neighbours.few_rows import sort_rows
from lidar_buildings.core.solids.output_grid import GRID, made_valid, polygons_of
from lidar_buildings.core.solids.validity import n_joints, weld


@dataclass(frozen=True, eq=False)
class RoofPiece:
    """A part of a building's plan that one plane covers."""

    #: Open; the exterior counter-clockwise, then the holes clockwise, map frame [m], shape (n_vertices, 2).
    rings: tuple[FloatArray, ...]
    plane: tuple[float, float, float]  #: (a, b, c) of the elevation a x + b y + c, map frame [m]

    def elevation(self, x: float, y: float) -> float:
        """Return the elevation of the plane at a place [m]."""
        a, b, c = self.plane
        return a * x + b * y + c


_Rings = tuple[FloatArray, ...]


def cut_at(
    rings: _Rings, plane: Sequence[float] | FloatArray, elevation: float
) -> tuple[list[_Rings], list[_Rings]]:
    """
    Return the rings, open, of the parts of a face above an elevation [m], and of the others.

    The face's exterior and holes may be unsound; its plane, z = a·x + b·y + c, is not level.
    """
    (polygon,) = made_valid(np.array([shapely.Polygon(rings[0], rings[1:])], dtype=object))
    upper = polygon.intersection(_half_plane(rings[0], np.asarray(plane), elevation))
    return _rings(upper), _rings(polygon.difference(upper))


def _half_plane(ring: FloatArray, plane: FloatArray, elevation: float) -> shapely.Polygon:
    """Return a rectangle over what of a ring lies above an elevation; it ends where the plane has that."""
    steepness = float(np.hypot(*plane[:2]))
    uphill = plane[:2] / steepness
    centre = ring.mean(axis=0)
    a, b, c = plane.tolist()
    x, y = centre.tolist()
    start = centre + (elevation - (a * x + b * y + c)) / steepness * uphill
    size = 4.0 * float(np.ptp(ring, axis=0).sum() + np.abs(start - centre).sum())
    across = size * np.array([-uphill[1], uphill[0]])
    return shapely.Polygon(
        [start - across, start + across, start + across + size * uphill, start - across + size * uphill]
    )


def _rings(geometry: shapely.Geometry) -> list[_Rings]:
    """Return the rings of all polygons of a geometry, open."""
    return [
        tuple(shapely.get_coordinates(ring)[:-1] for ring in (polygon.exterior, *polygon.interiors))
        for polygon in polygons_of(geometry)
    ]


#: Least height of a roof above the ground [m].
MIN_HEIGHT = 0.1
#: Pieces that are too low by less than this keep their planes: their columns are lifted [m].
_TOLERATED = 0.004


def with_minimum_height(pieces: Sequence[RoofPiece], ground_elevation: float) -> list[RoofPiece]:
    """Return the pieces, with what lies lower than `MIN_HEIGHT` above the ground replaced by flat pieces."""
    floor = ground_elevation + MIN_HEIGHT
    return [part for piece in pieces for part in _part_above(piece, floor)]


def _part_above(piece: RoofPiece, floor: float) -> list[RoofPiece]:
    """Return a piece itself, or what of it lies above a floor and the flat rest."""
    if not piece.rings or not len(piece.rings[0]):
        return []
    a, b, c = piece.plane
    elevations = piece.rings[0] @ (a, b) + c
    if elevations.min() >= floor - _TOLERATED:
        return [piece]
    flat = (0.0, 0.0, floor)
    if elevations.max() <= floor + _TOLERATED or not (a or b):
        return [RoofPiece(piece.rings, flat)]
    upper, lower = cut_at(piece.rings, piece.plane, floor)
    return [*(RoofPiece(rings, piece.plane) for rings in upper), *(RoofPiece(rings, flat) for rings in lower)]


class GridRings(NamedTuple):
    """Rings end to end, without repetitions and spikes."""

    corners: IntArray  #: open rings [steps of the grid], shape (n_corners, 2)
    starts: IntArray  #: where each ring begins among the corners, shape (n_rings + 1,)
    #: The piece that lies to the left of each ring: its exterior, counter-clockwise, comes before its holes,
    #: shape (n_rings,).
    owner: IntArray

    @property
    def following(self) -> IntArray:
        """The next corner along its ring of each corner."""
        following = np.arange(1, len(self.corners) + 1)
        following[self.starts[1:] - 1] = self.starts[:-1]
        return following

    @property
    def is_exterior(self) -> BoolArray:
        """Whether each ring is its piece's exterior."""
        return first_of_each(self.owner)


def piece_rings(pieces: Sequence[RoofPiece]) -> GridRings:
    """Return the rings of pieces; none of a piece whose exterior has no area."""
    rings = [ring for one in pieces for ring in one.rings]
    if not rings:
        return GridRings(np.empty((0, 2), np.int64), np.zeros(1, np.int64), np.empty(0, np.int64))
    owner = np.repeat(np.arange(len(pieces)), [len(one.rings) for one in pieces])
    starts = np.cumsum([0, *map(len, rings)])
    return grid_rings(np.concatenate(rings) / GRID, starts, first_of_each(owner), owner)


def first_of_each(owner: IntArray) -> BoolArray:
    """Say of each ring whether its owner is another one than that of the ring before."""
    is_first = np.ones(len(owner), dtype=np.bool_)
    is_first[1:] = owner[1:] != owner[:-1]
    return is_first


def grid_rings(
    corners: FloatArray | IntArray, starts: IntArray, is_exterior: BoolArray, owner: IntArray
) -> GridRings:
    """
    Put rings, in steps of the grid, on it: exteriors counter-clockwise, the holes that follow each clockwise.
    """
    corners, starts, owner = np.rint(corners).astype(np.int64), starts.copy(), owner.copy()
    n_rings = _clean(corners, starts, is_exterior, owner)
    return GridRings(corners[: starts[n_rings]], starts[: n_rings + 1], owner[:n_rings])


@kernel
def _clean(corners: IntArray, starts: IntArray, is_exterior: BoolArray, owner: IntArray) -> int:
    """Leave out repetitions, spikes, and rings without area, in place; return how many rings are left."""
    n_rings, filled, keeps_holes = 0, 0, False
    begin = starts[0]
    for number in range(len(owner)):
        end = starts[number + 1]
        first = filled
        for k in range(begin, end):
            x, y = corners[k, 0], corners[k, 1]
            if filled > first and corners[filled - 1, 0] == x and corners[filled - 1, 1] == y:
                continue
            if filled > first + 1 and corners[filled - 2, 0] == x and corners[filled - 2, 1] == y:
                filled -= 1  # back along the last edge
                continue
            corners[filled, 0], corners[filled, 1] = x, y
            filled += 1
        begin, head = end, first
        while filled - head > 2:
            is_last = (
                corners[filled - 1, 0] == corners[head, 0] and corners[filled - 1, 1] == corners[head, 1]
            )
            is_tip = corners[filled - 2, 0] == corners[head, 0] and corners[filled - 2, 1] == corners[head, 1]
            if is_last or is_tip:
                filled -= 1
            elif (
                corners[filled - 1, 0] == corners[head + 1, 0]
                and corners[filled - 1, 1] == corners[head + 1, 1]
            ):
                head += 1
            else:
                break
        if is_exterior[number]:
            keeps_holes = filled - head > 2
        if filled - head < 3 or not keeps_holes:
            filled = first
            continue
        doubled_area = 0
        for k in range(head, filled):
            after = k + 1 if k + 1 < filled else head
            doubled_area += (corners[k, 0] - corners[head, 0]) * (corners[after, 1] - corners[head, 1])
            doubled_area -= (corners[k, 1] - corners[head, 1]) * (corners[after, 0] - corners[head, 0])
        for k in range(head, filled):
            corners[first + k - head, 0], corners[first + k - head, 1] = corners[k, 0], corners[k, 1]
        filled -= head - first
        if (doubled_area > 0) != is_exterior[number]:
            for k in range((filled - first) // 2):
                for axis in range(2):
                    low, high = corners[first + k, axis], corners[filled - 1 - k, axis]
                    corners[first + k, axis], corners[filled - 1 - k, axis] = high, low
        owner[n_rings] = owner[number]
        n_rings += 1
        starts[n_rings] = filled
    return n_rings


#: Stands for what lies beside all pieces.
OUTSIDE = -1


class PlanGraph(NamedTuple):
    """The edges of a coverage."""

    places: IntArray  #: by x, then y [steps of the grid], shape (n_vertices, 2)
    ends: IntArray  #: rows of the places, the lower first; edges rise, shape (n_edges, 2)
    #: Number of the piece to the left of each edge and to its right, OUTSIDE for none, shape (n_edges, 2).
    sides: IntArray

    def joined(self, numbers: IntArray) -> PlanGraph:
        """Return the graph of pieces of which those of one number are one, without edges between them."""
        sides = np.append(numbers, OUTSIDE)[self.sides]
        parted = sides[:, 0] != sides[:, 1]
        return PlanGraph(self.places, self.ends[parted], sides[parted])


def labelled_graph(rings: GridRings) -> PlanGraph | None:
    """
    Return the graph of rings, None if two of them claim the same side of an edge.

    Edges between rings of the same piece are left out.
    """
    corners = rings.corners
    if not len(corners):
        return PlanGraph(corners, corners, corners)
    places, ends, sides = np.empty_like(corners), np.empty_like(corners), np.empty_like(corners)
    n, n_edges = _label(corners, rings.starts, rings.owner, places, ends, sides)
    return None if n_edges < 0 else PlanGraph(places[:n], ends[:n_edges], sides[:n_edges])


@kernel
def _label(corners, starts, owner, places, ends, sides):  # type: ignore[no-untyped-def]
    """Write places and edges; return how many there are, -1 edges if two rings claim the same side of one."""
    west, south, north = corners[0, 0], corners[0, 1], corners[0, 1]
    for k in range(len(corners)):
        west, south, north = min(west, corners[k, 0]), min(south, corners[k, 1]), max(north, corners[k, 1])
    size = len(corners)
    keys, rows, place = np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size, np.int64)
    for k in range(len(corners)):
        keys[k], rows[k] = (corners[k, 0] - west) * (north - south + 1) + corners[k, 1] - south, k
    sort_rows(keys, rows, len(keys))
    n = 0
    for k in range(len(keys)):
        if k == 0 or keys[k] != keys[k - 1]:
            places[n, 0], places[n, 1] = corners[rows[k], 0], corners[rows[k], 1]
            n += 1
        place[rows[k]] = n - 1
    # Twice the pair of places, and 1 more where the corner's edge runs from the higher to the lower one.
    ring_of = np.empty(len(corners), np.int64)
    for ring in range(len(owner)):
        for k in range(starts[ring], starts[ring + 1]):
            a, b = place[k], place[k + 1 if k + 1 < starts[ring + 1] else starts[ring]]
            keys[k], rows[k], ring_of[k] = 2 * (min(a, b) * n + max(a, b)) + (a > b), k, ring
    sort_rows(keys, rows, len(keys))
    n_edges, k = 0, 0
    while k < len(keys):
        left, right = OUTSIDE, OUTSIDE
        edge = keys[k] >> 1
        while k < len(keys) and keys[k] >> 1 == edge:
            if k > 0 and keys[k] == keys[k - 1]:
                return n, -1
            if keys[k] & 1:
                right = owner[ring_of[rows[k]]]
            else:
                left = owner[ring_of[rows[k]]]
            k += 1
        if left != right:
            ends[n_edges, 0], ends[n_edges, 1] = edge // n, edge % n
            sides[n_edges, 0], sides[n_edges, 1] = left, right
            n_edges += 1
    return n, n_edges


#: Vertices and edges of a plan that lie nearer to each other than this are brought together [grid steps].
LEAST_DISTANCE = 3.0


def matched_coverage(pieces: Sequence[RoofPiece], numbers: IntArray) -> PlanGraph:
    """
    Return the graph of the pieces, noded anew if they do not match edge by edge; those of one number are one.
    """
    rings = piece_rings(pieces)
    by_piece = labelled_graph(rings)
    if by_piece is not None and len(by_piece.ends):
        graph = by_piece.joined(numbers)
        # Edges that keep clear of each other cross nowhere and leave no slits.
        if _are_clear(by_piece.places[by_piece.ends]) and _are_simple(by_piece, rings):
            return graph
        outer = graph.ends[(graph.sides == OUTSIDE).any(axis=1)]
        if shapely.is_valid(_polygons(rings)).all() and _are_clear(graph.places[outer]):
            return graph
    return noded_coverage(pieces, numbers, LEAST_DISTANCE, 1.0)


def _are_clear(edges: IntArray) -> bool:
    return bool(n_joints(edges.reshape(-1, 4).astype(np.float64), LEAST_DISTANCE) >= 0)


def _are_simple(graph: PlanGraph, rings: GridRings) -> bool:
    """Whether each piece has one ring, which passes no place twice, and all edges of it are in the graph."""
    # The ring to the left of an edge goes on from its first end, that to the right from its other one.
    passed = (graph.sides * len(graph.places) + graph.ends)[graph.sides != OUTSIDE]
    passed.sort()
    is_all = len(passed) == len(rings.corners) and bool((passed[1:] > passed[:-1]).all())
    return is_all and bool(rings.is_exterior.all())


def _polygons(rings: GridRings) -> NDArray[np.object_]:
    """Return each piece as a polygon."""
    ring = np.repeat(np.arange(len(rings.owner)), np.diff(rings.starts))
    shells = shapely.linearrings(rings.corners.astype(np.float64), indices=ring)
    return np.asarray(shapely.polygons(shells, indices=np.cumsum(rings.is_exterior) - 1))


def noded_coverage(pieces: Sequence[RoofPiece], numbers: IntArray, within: float, grid: float) -> PlanGraph:
    """
    Return the graph of the faces into which the pieces' rings divide the plan, each given to one piece.

    However badly pieces match: vertices, gaps and overlaps narrower than `within` vanish, and all vertices
    come to lie on multiples of `grid`, through which edges nearer than half of it run (snap rounding, Hobby
    1999) [grid steps].
    """
    rings = piece_rings(pieces)
    nothing = PlanGraph(rings.corners[:0], rings.corners[:0], rings.corners[:0])
    if not len(rings.owner):
        return nothing
    rings = _snapped(rings, within)
    if not len(rings.owner):
        return nothing
    polygons = _polygons(rings)
    noded = shapely.union_all(shapely.boundary(polygons), grid_size=grid)
    faces = shapely.get_parts(shapely.polygonize([noded]))
    # Holes stay holes even where they have come to cross their exterior.
    sound = made_valid(polygons)
    labels = _labels(faces, sound, numbers[rings.owner[rings.is_exterior]])
    shells, face = shapely.get_rings(faces[labels != OUTSIDE], return_index=True)
    corners, ring = shapely.get_coordinates(shells, return_index=True)
    is_last = np.diff(ring, append=len(shells)) != 0
    starts = np.append(0, np.cumsum(np.bincount(ring, minlength=len(shells)) - 1))
    owner = labels[labels != OUTSIDE][face]
    graph = labelled_graph(grid_rings(corners[~is_last], starts, first_of_each(face), owner))
    return nothing if graph is None else graph


def _snapped(rings: GridRings, within: float) -> GridRings:
    """Move vertices onto others, or onto edges, that are nearer than `within`."""
    places, row = np.unique(rings.corners.astype(np.float64), axis=0, return_inverse=True)
    leader = weld(places, within)
    kept, starts = places[np.unique(leader)], places[leader[row.reshape(-1)]]
    steps = starts[rings.following] - starts
    lines = shapely.linestrings(np.stack([starts, starts + steps], axis=1))
    edge, near = shapely.STRtree(shapely.points(kept)).query(lines, predicate="dwithin", distance=within)
    length = np.einsum("ij,ij->i", steps, steps)
    share = np.einsum("ij,ij->i", kept[near] - starts[edge], steps[edge]) / np.maximum(length[edge], 1e-9)
    is_end = (kept[near] == starts[edge]).all(axis=1) | (kept[near] == starts[edge] + steps[edge]).all(axis=1)
    between = (share > 0.0) & (share < 1.0) & ~is_end
    edge, share, near = edge[between], share[between], near[between]
    # each corner, and after it what lies next to its edge
    corners = np.concatenate([starts, kept[near]])
    shares = np.append(np.zeros(len(starts)), share)
    order = np.lexsort((*corners.T[::-1], shares, np.append(np.arange(len(starts)), edge)))
    added = np.append(0, np.cumsum(np.bincount(edge, minlength=len(starts))))
    full = GridRings(corners[order].astype(np.int64), rings.starts + added[rings.starts], rings.owner)
    return grid_rings(full.corners, full.starts, full.is_exterior, full.owner)


def _labels(faces: NDArray[np.object_], polygons: NDArray[np.object_], owners: IntArray) -> IntArray:
    """Return the piece that each face belongs to: the first that covers it."""
    inside = shapely.point_on_surface(faces)
    hits = shapely.STRtree(polygons).query(inside, predicate="intersects")
    labels = np.full(len(faces), OUTSIDE)
    for face, polygon in sorted(hits.T.tolist(), reverse=True):
        labels[face] = owners[polygon]
    return labels
