"""Pieces of a roof made to match edge by edge."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import IntArray
from lidar_buildings.core.solids.clearance import n_joints
from lidar_buildings.core.solids.raising.grid_rings import GridRings, first_of_each, grid_rings, piece_rings
from lidar_buildings.core.solids.raising.plan_graph import OUTSIDE, PlanGraph, labelled_graph
from lidar_buildings.core.solids.raising.roof_piece import RoofPiece
from lidar_buildings.core.solids.validity.welding import weld

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
    sound = shapely.make_valid(polygons, method="structure", keep_collapsed=False)
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
