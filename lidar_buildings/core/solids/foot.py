"""The foot of a solid on level ground, draped on the terrain."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import shapely

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.solids.output_grid import GRID, on_grid
from lidar_buildings.core.solids.plan_graph import MIN_HEIGHT
from lidar_buildings.core.solids.shell import GROUND_SURFACE, WALL_SURFACE, Face, Solid, ring_edges
from lidar_buildings.core.solids.triangulation import face_arrays, triangulate

#: The terrain is looked at so often along a wall, whose foot keeps to it within this [m].
_STEP, _TOLERANCE = 0.5, 0.03


def draped_solid(solid: Solid, elevation_at: Callable[[FloatArray], FloatArray]) -> tuple[Solid, bool]:
    """
    Return a solid that stands on level ground with its foot on the terrain, and whether the foot was cut.

    Only the foot moves. Its vertices take the terrain's elevation; walls along which the terrain bends get
    more of them (Douglas and Peucker 1973). The ground becomes triangles, whose border is the foot. Where the
    terrain rises above what stands on the foot, this is cut `MIN_HEIGHT` below. What comes out is to be
    checked: triangles may pierce a roof that is lower than the terrain on both sides of it.

    - `elevation_at`: Gives the terrain's elevations at places, shape (n, 2) → (n,) [m].
    """
    vertices = solid.vertices.copy()
    edges = _foot_edges(solid)
    lines = shapely.segmentize(shapely.linestrings(vertices[edges, :2]), _STEP)
    places, line = shapely.get_coordinates(lines, return_index=True)
    first = np.searchsorted(line, np.arange(len(edges) + 1))
    ends = np.column_stack([first[:-1], first[1:] - 1])
    share = (np.arange(len(line)) - first[line]) / (np.diff(first) - 1)[line]
    tops = _tops_of_walls(solid, edges)[line]
    most = tops[:, 0] + share * (tops[:, 1] - tops[:, 0]) - MIN_HEIGHT
    most[ends] = _next_above(vertices)[edges] - MIN_HEIGHT
    terrain = elevation_at(places)
    z = on_grid(np.minimum(terrain, most))
    vertices[edges, 2] = z[ends]

    along = share * shapely.length(lines)[line]
    profiles = shapely.linestrings(np.column_stack([along, z, np.arange(len(z))]), indices=line)
    bends = shapely.get_coordinates(
        shapely.simplify(profiles, _TOLERANCE, preserve_topology=False), include_z=True
    )[:, 2]
    between = np.setdiff1d(bends.astype(np.int64), ends)
    rows = len(vertices) + np.arange(len(between))
    chains = dict(zip(map(tuple, edges.tolist()), _split(rows, line[between], len(edges)), strict=True))
    chains |= {(b, a): chain[::-1] for (a, b), chain in chains.items()}
    vertices = np.concatenate([vertices, np.column_stack([on_grid(places[between]), z[between]])])
    return _on_foot(solid, vertices, chains), bool((terrain > most + GRID).any())


def _foot_edges(solid: Solid) -> IntArray:
    """Return both rows of each edge of the ground, that with the lower x, or y, first; shape (n_edges, 2)."""
    # so neighbours divide a common wall alike
    faces = zip(solid.faces, solid.semantics, strict=True)
    rings = [ring for face, kind in faces if kind == GROUND_SURFACE for ring in face]
    edges = np.array([edge for ring in rings for edge in ring_edges(ring)])
    (x, y), (u, v) = (solid.vertices[rows, :2].T for rows in edges.T)
    is_falling = (x > u) | ((x == u) & (y > v))
    edges[is_falling] = edges[is_falling, ::-1]
    return edges


def _tops_of_walls(solid: Solid, edges: IntArray) -> FloatArray:
    """Return how high the wall on each edge of the foot reaches at both ends [m], shape (n_edges, 2)."""
    number = {edge: k for k, edge in enumerate(map(tuple, edges.tolist()))}
    number |= {(b, a): k for (a, b), k in number.items()}
    tops = np.full(edges.shape, np.inf)
    for face, kind in zip(solid.faces, solid.semantics, strict=True):
        for edge in ring_edges(face[0]) if kind == WALL_SURFACE else ():
            if edge in number:
                corners = solid.vertices[list(face[0])]
                is_first = (corners[:, :2] == solid.vertices[edges[number[edge], 0], :2]).all(axis=1)
                tops[number[edge]] = corners[is_first, 2].max(), corners[~is_first, 2].max()
    return tops


def _next_above(vertices: FloatArray) -> FloatArray:
    """Return the elevation of the next vertex above each one, infinite if there is none [m]."""
    order = np.lexsort(vertices.T[::-1])
    above = np.full(len(vertices), np.inf)
    lower, upper = order[:-1], order[1:]
    is_same = (vertices[lower, :2] == vertices[upper, :2]).all(axis=1)
    above[lower[is_same]] = vertices[upper[is_same], 2]
    return above


def _split(rows: IntArray, group: IntArray, n: int) -> list[list[int]]:
    """Return the rows of each of n rising groups."""
    first = np.searchsorted(group, np.arange(n + 1)).tolist()
    return [rows[a:b].tolist() for a, b in pairwise(first)]


def _on_foot(solid: Solid, vertices: FloatArray, chains: dict[tuple[int, int], list[int]]) -> Solid:
    """Return a solid of moved vertices with more of them along the edges of its foot."""

    def widened(face: Face) -> Face:
        edges = map(ring_edges, face)
        return tuple(tuple(v for a, b in ring for v in (a, *chains.get((a, b), ()))) for ring in edges)

    faces = list(zip(map(widened, solid.faces), solid.semantics, strict=True))
    ground = Solid(vertices, tuple(face for face, kind in faces if kind == GROUND_SURFACE), ())
    arrays = face_arrays(ground)
    plan = (vertices[arrays.corners, :2] - vertices[0, :2]) * (1.0, -1.0)  # as seen from below
    triangles, _ = triangulate(arrays, plan)
    others = [(face, kind) for face, kind in faces if kind != GROUND_SURFACE]
    kinds = (*[GROUND_SURFACE] * len(triangles), *(kind for _, kind in others))
    below: list[Face] = [(tuple(corners),) for corners in triangles.tolist()]
    return Solid(vertices, (*below, *(face for face, _ in others)), kinds)
