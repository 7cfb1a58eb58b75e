"""The cells into which lines cut an outline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.stages.building_model.graph_rings import rings_round
from lidar_buildings.core.stages.building_model.noding import node_segments
from lidar_buildings.core.stages.building_model.planar_graph import (
    Rotation,
    enclosed_cells,
)


@dataclass(frozen=True, eq=False)
class Cells:
    """
    A coverage of an outline by cells that share whole edges.

    Attributes
    ----------
    vertices : ndarray of shape (n_vertices, 2)
        By rising x, then y; multiples of the output grid [m].
    borders : ndarray of shape (n_borders, 2), int64
        Rows of the two vertices of every edge, the lower one first.
    sides : ndarray of shape (n_borders, 2), int64
        The cell to the left of each edge and that to the right, -1 = none.
    areas : ndarray of shape (n_cells,)
        [m²].
    corners : ndarray of int64
        Rows of the outline's own vertices.
    """

    vertices: FloatArray
    borders: IntArray
    sides: IntArray
    areas: FloatArray
    corners: IntArray
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
        Return the rings of faces that consist of cells.

        Parameters
        ----------
        face : ndarray of shape (n_cells,), int64
            Number of each cell's face.
        kept : ndarray of shape (n_vertices,), bool
            The vertices that rings show.
        """
        number = np.append(face, -1)[self.sides].reshape(-1)
        rings = rings_round(self._units, self.borders, self._rotation, number, kept)
        return [tuple(self.vertices[rows] for rows in group) for group in rings]


def cut_into_cells(outline: Outline, segments: FloatArray) -> Cells:
    """
    Cut an outline along segments.

    The lines are noded with snap rounding on the output grid, so that the cells are valid as they will be
    written. Segments that end inside do not cut: see `extend_segments`.

    Parameters
    ----------
    outline : Outline
        Valid, on the output grid, its outer ring counter-clockwise and its holes clockwise [m].
    segments : ndarray of shape (n_segments, 2, 2)
        Ends in plan [m].
    """
    units, borders, enclosed, corners = node_segments(walls_of(outline), segments)
    first, order, place, sides, doubled = enclosed_cells(units, borders, enclosed)
    scale = round(1.0 / GRID)
    areas, rotation = 0.5 * doubled / scale**2, Rotation(first, order, place)
    return Cells(units / scale, borders, sides, areas, corners, units, rotation)


def walls_of(outline: Outline) -> FloatArray:
    """Return the edges of an outline, shape (n_walls, 2, 2) [m]."""
    return ring_walls(outline.rings)
