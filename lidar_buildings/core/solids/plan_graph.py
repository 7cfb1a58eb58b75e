"""
The plan of a roof as a planar graph, from pieces that need not match: which piece lies beside each edge.

Vertices are whole grid steps (millimetres), so that equal places are equal numbers and nothing is rounded
twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.solids.output_grid import GRID, made_valid, polygons_of
from lidar_buildings.core.solids.planar_subdivision import (
    OUTSIDE,
    PlanGraph,
    divide_plane,
    face_owners,
    graph_of,
)
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
    upper, lower = _half_planes(rings[0], np.asarray(plane), elevation)
    # a difference would leave a hair along an edge that the cut's end lies beside
    return _rings(polygon.intersection(upper)), _rings(polygon.intersection(lower))


def _half_planes(ring: FloatArray, plane: FloatArray, elevation: float) -> tuple[Any, Any]:
    """Return rectangles over what of a ring lies above and below an elevation; both end where it is."""
    steepness = float(np.hypot(*plane[:2]))
    uphill = plane[:2] / steepness
    centre = ring.mean(axis=0)
    a, b, c = plane.tolist()
    x, y = centre.tolist()
    start = centre + (elevation - (a * x + b * y + c)) / steepness * uphill
    size = 4.0 * float(np.ptp(ring, axis=0).sum() + np.abs(start - centre).sum())
    across = size * np.array([-uphill[1], uphill[0]])
    ends = [start - across, start + across]
    upper, lower = ([*ends, ends[1] + way, ends[0] + way] for way in (size * uphill, -size * uphill))
    return shapely.Polygon(upper), shapely.Polygon(lower)


def _rings(geometry: shapely.Geometry) -> list[_Rings]:
    return [rings_of(polygon) for polygon in polygons_of(geometry) if not polygon.is_empty]


def rings_of(polygon: shapely.Polygon) -> _Rings:
    """Return a polygon's rings, open."""
    return tuple(shapely.get_coordinates(ring)[:-1] for ring in (polygon.exterior, *polygon.interiors))


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


#: Vertices and edges of a plan that lie nearer to each other than this are brought together [grid steps].
LEAST_DISTANCE = 3.0


def matched_coverage(pieces: Sequence[RoofPiece], numbers: IntArray) -> PlanGraph:
    """Return the graph of the pieces, noded anew if they do not match; those of one number are one."""
    polygons, own = _polygons(pieces)
    if shapely.is_valid(polygons).all():
        graph = graph_of(polygons, numbers[own])
        # Outer edges that keep clear of each other leave no slits.
        if graph is not None:
            outer = graph.places[graph.ends[(graph.sides == OUTSIDE).any(axis=1)]]
            if n_joints(outer.reshape(-1, 4).astype(np.float64), LEAST_DISTANCE) >= 0:
                return graph
    return noded_coverage(pieces, numbers, LEAST_DISTANCE, 1.0)


def _polygons(pieces: Sequence[RoofPiece]) -> tuple[NDArray[np.object_], IntArray]:
    """Return the pieces that have an exterior as polygons [grid steps], and the number of each."""
    numbers = [k for k, piece in enumerate(pieces) if piece.rings and len(piece.rings[0]) >= 3]
    if not numbers:
        return np.empty(0, dtype=object), np.empty(0, dtype=np.int64)
    rings = [(k, ring) for k in numbers for ring in pieces[k].rings if len(ring) >= 3]
    owner, sizes = np.array([k for k, _ in rings]), [len(ring) for _, ring in rings]
    corners = np.rint(np.concatenate([ring for _, ring in rings]) / GRID)
    lines = shapely.linearrings(corners, indices=np.repeat(np.arange(len(rings)), sizes))
    polygons = shapely.polygons(lines, indices=np.searchsorted(numbers, owner))
    return np.asarray(polygons), np.array(numbers)


def joined(graph: PlanGraph, numbers: IntArray) -> PlanGraph:
    """Return a graph whose owners k have become numbers[k], without the edges between equal ones."""
    sides = np.where(graph.sides == OUTSIDE, OUTSIDE, numbers[graph.sides])
    parted = sides[:, 0] != sides[:, 1]
    return PlanGraph(graph.places, graph.ends[parted], sides[parted])


def noded_coverage(pieces: Sequence[RoofPiece], numbers: IntArray, within: float, grid: float) -> PlanGraph:
    """
    Return the graph of the faces into which the pieces' rings divide the plan, each given to one piece.

    However badly pieces match: vertices, gaps and overlaps narrower than `within` vanish, and all vertices
    come to lie on multiples of `grid` [grid steps].
    """
    polygons, own = _polygons(pieces)
    faces = divide_plane(_snapped(polygons, within), grid)
    # Holes stay holes even where they have come to cross their exterior.
    owner = face_owners(faces, made_valid(polygons))
    covered = owner != OUTSIDE
    graph = graph_of(faces[covered], numbers[own][owner[covered]])
    if graph is None:
        raise RuntimeError("faces of one subdivision overlap")
    return graph


def _snapped(polygons: NDArray[np.object_], within: float) -> NDArray[np.object_]:
    """Return the edges of polygons, their ends moved onto others, through vertices nearer than `within`."""
    corners, ring = shapely.get_coordinates(shapely.get_rings(polygons), return_index=True)
    places, row = np.unique(corners, axis=0, return_inverse=True)
    leader = weld(places, within)[row.reshape(-1)]
    edges = np.column_stack([leader[:-1], leader[1:]])[ring[1:] == ring[:-1]]
    lines, kept = shapely.linestrings(places[edges]), np.unique(leader)
    points = shapely.points(places[kept])
    edge, near = shapely.STRtree(points).query(lines, predicate="dwithin", distance=within)
    along = shapely.line_locate_point(lines[edge], points[near])
    is_end = (edges[edge] == kept[near, None]).any(axis=1)
    between = is_end | ((along > 0.0) & (along < shapely.length(lines[edge])))
    order = np.lexsort((along[between], edge[between]))
    edge, chain = edge[between][order], places[kept[near[between][order]]]
    pieces = np.stack([chain[:-1], chain[1:]], axis=1)[edge[1:] == edge[:-1]]
    return np.asarray(shapely.linestrings(pieces))
