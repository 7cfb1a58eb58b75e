"""The cells into which lines cut an outline, and the rings round sets of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.stages.building_model.noding import node_segments
from lidar_buildings.core.stages.building_model.planar_graph import Rotation, enclosed_cells, next_half_edge


@dataclass(frozen=True, eq=False)
class Cells:
    """A coverage of an outline by cells that share whole edges."""

    vertices: FloatArray  #: by rising x, then y; multiples of the output grid [m], shape (n_vertices, 2)
    borders: IntArray  #: rows of the two vertices of every edge, the lower one first, shape (n_borders, 2)
    #: The cell to the left of each edge and that to the right, -1 = none, shape (n_borders, 2).
    sides: IntArray
    areas: FloatArray  #: [m²], shape (n_cells,)
    corners: IntArray  #: rows of the outline's own vertices
    _units: IntArray
    _rotation: Rotation

    def __len__(self) -> int:
        """Return the number of cells."""
        return len(self.areas)

    @property
    def polygons(self) -> NDArray[np.object_]:
        """The cells as polygons."""
        every = np.ones(len(self.vertices), dtype=np.bool_)
        rings = self.rings_of(np.arange(len(self)), every)
        return np.array([shapely.Polygon(group[0], group[1:]) for group in rings], dtype=object)

    def rings_of(self, face: IntArray, kept: BoolArray) -> list[tuple[FloatArray, ...]]:
        """
        Return the rings of faces, each of the cells with its number, that show the vertices that are kept.
        """
        number = np.append(face, -1)[self.sides].reshape(-1)
        rings = rings_round(self._units, self.borders, self._rotation, number, kept)
        return [tuple(self.vertices[rows] for rows in group) for group in rings]


def cut_into_cells(outline: Outline, segments: FloatArray) -> Cells:
    """
    Cut an outline, valid and on the output grid, along segments.

    The lines are noded with snap rounding on the output grid, so that the cells are valid as they will be
    written. Segments that end inside do not cut: see `extend_segments`.
    """
    units, borders, enclosed, corners = node_segments(ring_walls(outline.rings), segments)
    first, order, place, sides, doubled = enclosed_cells(units, borders, enclosed)
    scale = round(1.0 / GRID)
    areas, rotation = 0.5 * doubled / scale**2, Rotation(first, order, place)
    return Cells(units / scale, borders, sides, areas, corners, units, rotation)


def rings_round(
    vertices: IntArray, edges: IntArray, rotation: Rotation, face: IntArray, kept: BoolArray
) -> list[list[IntArray]]:
    """
    Return the rings round faces or sets of them: per face its outer ring, counter-clockwise, then its holes.

    `face` is the one to the left of each half-edge, -1 = none; rings show the vertices that are `kept`. They
    are simple, begin at their first vertex, and are rows of vertices; a face without a ring of three has
    none.
    """
    ends = edges.reshape(-1)
    corners = np.empty(len(ends), dtype=np.int64)
    ring = np.zeros((len(ends) + 1, 3), dtype=np.int64)
    n = _walk_round(vertices, ends, *rotation, face, kept, corners, ring)
    rings: list[list[IntArray]] = [[] for _ in range(int(face.max(initial=-1)) + 1)]
    outer = [-1] * len(rings)
    for k, (start, owner, area) in enumerate(ring[:n].tolist()):
        own = corners[start : ring[k + 1, 0]]
        if area > 0:
            outer[owner] = len(rings[owner])
        rings[owner].append(own)
    return [[group.pop(k), *group] if k >= 0 else [] for group, k in zip(rings, outer, strict=True)]


@kernel
def _walk_round(vertices, ends, first, order, place, face, kept, corners, ring):  # type: ignore[no-untyped-def]
    """Write all rings, and where each begins, its face and twice its area; return how many there are."""
    done = np.zeros(len(ends), np.bool_)
    at = np.full(len(first), -1, np.int64)
    stack = np.empty(len(ends) + 1, np.int64)
    n = 0
    for begin in range(len(ends)):
        if done[begin] or face[begin] < 0 or face[begin] == face[begin ^ 1]:
            continue
        half, depth = begin, 0
        while True:
            v = ends[half]
            if at[v] >= 0:
                # The walk has come back to a vertex: what lies between is a ring of its own.
                low, count = at[v], 0
                for k in range(low, depth):
                    at[stack[k]] = -1
                    if kept[stack[k]]:
                        stack[low + count] = stack[k]
                        count += 1
                depth = low
                if count >= 3:
                    lowest = low
                    for k in range(low, low + count):
                        lowest = k if stack[k] < stack[lowest] else lowest
                    start, area = ring[n, 0], 0
                    x, y = vertices[stack[lowest], 0], vertices[stack[lowest], 1]
                    for k in range(count):
                        a = stack[low + (lowest - low + k) % count]
                        b = stack[low + (lowest - low + k + 1) % count]
                        corners[start + k] = a
                        area += (vertices[a, 0] - x) * (vertices[b, 1] - y)
                        area -= (vertices[a, 1] - y) * (vertices[b, 0] - x)
                    ring[n, 1], ring[n, 2], ring[n + 1, 0] = face[begin], area, start + count
                    n += 1
            if done[half]:
                break
            done[half] = True
            at[v], stack[depth] = depth, v
            depth += 1
            half = next_half_edge(half, ends, first, order, place, face)
    return n
