"""Pieces of a roof made to match edge by edge."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.solids.raising.plan_graph import (
    OUTSIDE,
    PlanGraph,
    Vertex,
    grid_ring,
    labelled_graph,
    piece_rings,
)
from lidar_buildings.core.solids.raising.roof_piece import RoofPiece
from lidar_buildings.core.solids.validity.welding import weld

#: Vertices and edges of a plan that lie nearer to each other than this are brought together [grid steps].
LEAST_DISTANCE = 3.0


def matched_coverage(pieces: Sequence[RoofPiece]) -> PlanGraph:
    """Return the graph of the pieces, noded anew if they do not match edge by edge."""
    rings = [piece_rings(piece) for piece in pieces]
    graph = labelled_graph(list(enumerate(rings)))
    if graph is not None and _matches(graph, rings):
        return graph
    return noded_coverage(pieces, LEAST_DISTANCE, 1.0)


def _matches(graph: PlanGraph, rings: list[list[list[Vertex]]]) -> bool:
    """
    Whether the edges left over bound one sound region without slits, and the pieces themselves are sound.
    """
    polygons = [shapely.Polygon(group[0], group[1:]) for group in rings if group]
    if not shapely.is_valid(np.array(polygons, dtype=object)).all():
        return False
    edges = np.array([edge for edge, piece in graph.left.items() if piece == OUTSIDE], dtype=np.float64)
    return len(edges) > 0 and not _has_slit(edges)


def _has_slit(edges: FloatArray) -> bool:
    """Whether an end of an edge lies next to another edge that it does not belong to, shape (n, 2, 2)."""
    lines = shapely.linestrings(edges)
    ends = np.unique(edges[:, 0], axis=0)
    points = shapely.points(ends)
    near = shapely.STRtree(lines).query(points, predicate="dwithin", distance=LEAST_DISTANCE)
    apart = (edges[near[1]] != ends[near[0], None, :]).any(axis=2).all(axis=1)
    if apart.any():
        return True
    crossing = shapely.STRtree(lines).query(lines, predicate="crosses")
    return bool(crossing.size)


def noded_coverage(pieces: Sequence[RoofPiece], within: float, grid: float) -> PlanGraph:
    """
    Return the graph of the faces into which the pieces' rings divide the plan, each given to one piece.

    Parameters
    ----------
    pieces : sequence of RoofPiece
        The pieces, however badly they match.
    within : float
        Vertices, gaps and overlaps narrower than this vanish [grid steps].
    grid : float
        All vertices come to lie on multiples of this, edges nearer than half of it to a vertex run through it
        (snap rounding, Hobby 1999) [grid steps].
    """
    rings = [piece_rings(piece) for piece in pieces]
    if not any(rings):
        return PlanGraph({})
    rings = _snapped(rings, within)
    polygons = [_sound(shapely.Polygon(group[0], group[1:])) for group in rings if group]
    owners = [number for number, group in enumerate(rings) if group]
    if not polygons:
        return PlanGraph({})
    lines = [shapely.LineString([*ring, ring[0]]) for group in rings for ring in group]
    noded = shapely.union_all(lines, grid_size=grid)
    faces = shapely.get_parts(shapely.polygonize([noded]))
    labels = _labels(faces, polygons, owners, within)
    labelled = [
        (
            int(label),
            [grid_ring(np.asarray(ring.coords)[:-1], ccw=k == 0) for k, ring in enumerate(_rings(face))],
        )
        for face, label in zip(faces, labels, strict=True)
        if label != OUTSIDE
    ]
    return labelled_graph(labelled) or PlanGraph({})


def _snapped(rings: list[list[list[Vertex]]], within: float) -> list[list[list[Vertex]]]:
    """Move vertices onto others, or onto edges, that are nearer than `within`."""
    places = np.array(
        sorted({vertex for group in rings for ring in group for vertex in ring}), dtype=np.float64
    )
    leader = weld(places, within)
    target = {
        (int(x), int(y)): (int(places[to, 0]), int(places[to, 1]))
        for (x, y), to in zip(places, leader, strict=True)
    }
    kept = np.unique(places[leader], axis=0)
    moved = [
        [
            grid_ring(np.array(_with_vertices([target[v] for v in ring], kept, within)), ccw=k == 0)
            for k, ring in enumerate(group)
        ]
        for group in rings
    ]
    return [[ring for ring in group if ring] if group and group[0] else [] for group in moved]


def _with_vertices(ring: list[Vertex], places: FloatArray, within: float) -> list[Vertex]:
    """Put all places that lie next to an edge of a ring into it."""
    tree = shapely.STRtree(shapely.points(places))
    full: list[Vertex] = []
    for start, end in zip(ring, [*ring[1:], *ring[:1]], strict=True):
        full.append(start)
        if start == end:
            continue
        near = tree.query(shapely.LineString([start, end]), predicate="dwithin", distance=within)
        along = (
            (places[near] - start)
            @ np.subtract(end, start)
            / np.dot(np.subtract(end, start), np.subtract(end, start))
        )
        between = sorted(
            (share, *places[k].astype(int).tolist()) for share, k in zip(along, near, strict=True)
        )
        full += [(x, y) for share, x, y in between if 0.0 < share < 1.0 and (x, y) not in (start, end)]
    return full


def _labels(
    faces: NDArray[np.object_], polygons: list[shapely.Geometry], owners: list[int], within: float
) -> IntArray:
    """Return the piece that each face belongs to: the first that covers it; slivers go to a neighbour."""
    inside = shapely.point_on_surface(faces)
    hits = shapely.STRtree(polygons).query(inside, predicate="intersects")
    labels = np.full(len(faces), OUTSIDE)
    for face, polygon in sorted(hits.T.tolist(), reverse=True):
        labels[face] = owners[polygon]
    widths = 2.0 * shapely.area(faces) / shapely.length(faces)
    for face in np.flatnonzero((labels == OUTSIDE) & (widths < within)):
        others = np.flatnonzero(labels != OUTSIDE)
        shared = shapely.length(
            shapely.intersection(shapely.boundary(faces[others]), shapely.boundary(faces[face]))
        )
        if len(shared) and shared.max() > 0.0:
            labels[face] = labels[others[int(np.argmax(shared))]]
    return labels


def _sound(polygon: shapely.Polygon) -> shapely.Geometry:
    """Return a polygon whose holes stay holes even where they have come to cross its exterior."""
    return shapely.make_valid(polygon, method="structure", keep_collapsed=False)


def _rings(polygon: shapely.Polygon) -> list[shapely.LinearRing]:
    return [polygon.exterior, *polygon.interiors]
