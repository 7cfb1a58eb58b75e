"""The cells into which lines cut an outline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.output_grid import GRID

#: An end that misses an obstacle by so little meets it: less than a line moves by rounding [m].
_SLACK = 1e-3


@dataclass(frozen=True, eq=False)
class Cells:
    """
    A coverage of an outline by polygons that share whole edges.

    Attributes
    ----------
    polygons : ndarray of shape (n_cells,), object
        Coordinates are multiples of the output grid.
    edges : ndarray of shape (n_edges, 2), int64
        The two cells on either side of each inner edge.
    ends : ndarray of shape (n_edges, 4)
        x and y of the edge's two ends [m].
    """

    polygons: NDArray[np.object_]
    edges: IntArray
    ends: FloatArray

    @property
    def lengths(self) -> FloatArray:
        """Length of each inner edge [m]."""
        return np.hypot(self.ends[:, 2] - self.ends[:, 0], self.ends[:, 3] - self.ends[:, 1])


def cut_into_cells(outline: Outline, segments: FloatArray) -> Cells:
    """
    Cut an outline along segments.

    The lines are noded with snap rounding (Hobby 1999) on the output grid, so that the cells are valid as
    they will be written. Segments that end inside do not cut: see `extend_segments`.

    Parameters
    ----------
    outline : Outline
        Valid, on the output grid [m].
    segments : ndarray of shape (n_segments, 2, 2)
        Ends in plan [m].
    """
    whole = outline.polygon
    if not len(segments):
        return _cells(np.array([whole], dtype=object))
    lines = [shapely.boundary(whole), *shapely.linestrings(segments)]
    noded = shapely.union_all(lines, grid_size=GRID)
    parts = shapely.get_parts(shapely.polygonize([noded]))
    shapely.prepare(whole)
    inside = shapely.contains(whole, shapely.point_on_surface(parts))
    return _cells(parts[inside])


def _cells(polygons: NDArray[np.object_]) -> Cells:
    order = np.lexsort(shapely.bounds(polygons).T[::-1])
    polygons = polygons[order]
    rings, owner = shapely.get_rings(polygons, return_index=True)
    corners, ring_of = shapely.get_coordinates(rings, return_index=True)
    follows = ring_of[1:] == ring_of[:-1]
    start, end = corners[:-1][follows], corners[1:][follows]
    cell = owner[ring_of[:-1][follows]]
    swap = (start[:, 0] > end[:, 0]) | ((start[:, 0] == end[:, 0]) & (start[:, 1] > end[:, 1]))
    ends = np.where(swap[:, None], np.hstack([end, start]), np.hstack([start, end]))
    order = np.lexsort((cell, *ends.T[::-1]))
    ends, cell = ends[order], cell[order]
    twin = np.flatnonzero((ends[1:] == ends[:-1]).all(axis=1))
    pairs = np.column_stack([cell[twin], cell[twin + 1]]).astype(np.int64)
    apart = pairs[:, 0] != pairs[:, 1]
    return Cells(polygons, pairs[apart], ends[twin][apart])


def extend_segments(segments: FloatArray, walls: FloatArray) -> FloatArray:
    """
    Extend segments at both ends to the nearest other segment or wall.

    Whether a cut is used is decided later; a segment that ends too early would not cut at all.

    Parameters
    ----------
    segments : ndarray of shape (n_segments, 2, 2)
        Ends in plan [m].
    walls : ndarray of shape (n_walls, 2, 2)
        Edges of the outline [m].

    Returns
    -------
    ndarray of shape (n_segments, 2, 2)
    """
    if not len(segments):
        return segments
    obstacles = np.ascontiguousarray(np.concatenate([segments, walls]))
    extended = np.empty_like(segments)
    _extend(np.ascontiguousarray(segments), obstacles, extended)
    return extended


@njit(cache=True, nogil=True)
def _extend(segments: FloatArray, obstacles: FloatArray, extended: FloatArray) -> None:
    """Write the extended segments; an obstacle with the segment's own row is no obstacle."""
    for i in range(len(segments)):
        for side in range(2):
            x, y = segments[i, side]
            dx, dy = x - segments[i, 1 - side, 0], y - segments[i, 1 - side, 1]
            length = np.hypot(dx, dy)
            reach = _reach(x, y, dx / length, dy / length, i, obstacles) if length > 0.0 else 0.0
            extended[i, side, 0] = x + reach * dx / length if length > 0.0 else x
            extended[i, side, 1] = y + reach * dy / length if length > 0.0 else y


@njit(cache=True, nogil=True)
def _reach(x: float, y: float, dx: float, dy: float, own: int, obstacles: FloatArray) -> float:
    """Return how far a ray runs to the nearest obstacle [m]; 0 where none is met."""
    nearest = np.inf
    for j in range(len(obstacles)):
        if j == own:
            continue
        ax, ay = obstacles[j, 0]
        ex, ey = obstacles[j, 1, 0] - ax, obstacles[j, 1, 1] - ay
        cross = dx * ey - dy * ex
        if abs(cross) <= 1e-9 * np.hypot(ex, ey):
            continue
        t = ((ax - x) * ey - (ay - y) * ex) / cross
        u = ((ax - x) * dy - (ay - y) * dx) / cross
        slack = _SLACK / max(np.hypot(ex, ey), _SLACK)
        if u < -slack or u > 1.0 + slack or t < -_SLACK:
            continue
        nearest = min(nearest, max(t, 0.0))
    return nearest if np.isfinite(nearest) else 0.0
