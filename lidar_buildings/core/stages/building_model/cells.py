"""
The cells into which lines cut an outline.

Vertices are rounded to the output grid, so that cells are valid as they will be written.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.neighbours.few_rows import rows_by_group
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.solids.planar_subdivision import (
    OUTSIDE,
    divide_plane,
    face_owners,
    graph_of,
    straight_places,
    straightened_rings,
)

#: How far lines may miss one another and still meet [m].
_SLACK = 1e-6
#: Segments go on so far behind what they pass: walls and segments that near are at one place [m].
_PAST = 0.01


def extend_segments(segments: FloatArray, walls: FloatArray, n_steps: int = 0) -> FloatArray:
    """
    Extend segments at both ends to the nearest other segment or wall, steps past it to the one behind.

    Whether a cut is used is decided later; a segment that ends too early would not cut at all. Where steps,
    the first `n_steps`, lie a little beside one another, each has to run on beside the other to be the one
    that is chosen.
    """
    extended = np.empty((len(segments), 4))
    _extend(np.concatenate([segments, walls]).reshape(-1, 4), n_steps, extended)
    return extended.reshape(-1, 2, 2)


@kernel
def _extend(obstacles, n_steps, extended):  # type: ignore[no-untyped-def]
    """Write the extended segments, the first of the obstacles; none is an obstacle to itself."""
    for i in range(len(extended)):
        for end in range(2):
            x, y = obstacles[i, 2 * end], obstacles[i, 2 * end + 1]
            dx, dy = x - obstacles[i, 2 - 2 * end], y - obstacles[i, 3 - 2 * end]
            length = np.hypot(dx, dy)
            if length > 0.0:
                dx, dy = dx / length, dy / length
                reach, is_wall = _reach(x, y, dx, dy, i, len(extended), obstacles)
                x, y = x + reach * dx, y + reach * dy
                if i < n_steps and not is_wall:
                    x, y = x + _PAST * dx, y + _PAST * dy
                    reach, _ = _reach(x, y, dx, dy, i, len(extended), obstacles)
                    x, y = x + reach * dx, y + reach * dy
            extended[i, 2 * end], extended[i, 2 * end + 1] = x, y


@kernel
def _reach(x, y, dx, dy, own, n_segments, obstacles):  # type: ignore[no-untyped-def]
    """Return how far a ray runs to the nearest obstacle [m] and whether that is a wall; 0 if none is met."""
    nearest, wall = np.inf, np.inf
    for j in range(len(obstacles)):
        ax, ay = obstacles[j, 0], obstacles[j, 1]
        ex, ey = obstacles[j, 2] - ax, obstacles[j, 3] - ay
        u, v = dx * (ay - y) - dy * (ax - x), dx * (obstacles[j, 3] - y) - dy * (obstacles[j, 2] - x)
        if j == own or (u > _SLACK and v > _SLACK) or (u < -_SLACK and v < -_SLACK):
            continue
        cross, length = dx * ey - dy * ex, np.hypot(ex, ey)
        if abs(cross) <= 1e-9 * length:
            continue
        t = ((ax - x) * ey - (ay - y) * ex) / cross
        u = ((ax - x) * dy - (ay - y) * dx) / cross
        slack = _SLACK / max(length, _SLACK)
        if u < -slack or u > 1.0 + slack or t < -_SLACK:
            continue
        nearest = min(nearest, max(t, 0.0))
        if j >= n_segments:
            wall = min(wall, max(t, 0.0))
    return (nearest, wall <= nearest + _PAST) if nearest < np.inf else (0.0, True)


@dataclass(frozen=True, eq=False)
class Cells:
    """A coverage of an outline by cells that share whole edges."""

    polygons: NDArray[np.object_]  #: by the lower corner of the box round each [steps of the grid]
    vertices: FloatArray  #: by rising x, then y; multiples of the output grid [m], shape (n_vertices, 2)
    borders: IntArray  #: rows of the two vertices of every edge, the lower one first, shape (n_borders, 2)
    #: The cell to the left of each edge and that to the right, -1 = none, shape (n_borders, 2).
    sides: IntArray
    areas: FloatArray  #: [m²], shape (n_cells,)

    def __len__(self) -> int:
        return len(self.areas)


#: Rounding moves edges by less [steps of the grid].
_ROUNDED = 2.0


def cut_into_cells(outline: Outline, segments: FloatArray) -> Cells:
    """
    Cut an outline, valid and on the output grid, along segments.

    Segments that end inside do not cut: see `extend_segments`.
    """
    steps = shapely.transform(outline.polygon, lambda xy: np.rint(xy / GRID))
    lines = shapely.linestrings(segments / GRID)
    faces = divide_plane(np.append(lines, steps.boundary), 1.0) if len(segments) else np.array([steps])
    cells = _cells_of(faces[face_owners(faces, np.array([steps])) != OUTSIDE])
    if cells is None:
        raise RuntimeError("faces of one subdivision overlap")
    return cells


def cut_again(cells: Cells, group: IntArray, segments: FloatArray) -> Cells:
    """
    Return the cells of each group, numbered from 0, as one, and those that segments run through cut.

    All are cut anew if those do not fit the others any more: what was rounded once may be rounded again.
    """
    joined = _joined(cells, group)
    lines = shapely.linestrings(segments / GRID)
    _, near = shapely.STRtree(joined).query(lines, predicate="dwithin", distance=_ROUNDED)
    is_near = np.bincount(near, minlength=len(joined)) > 0
    for is_cut in (is_near, np.ones_like(is_near)):
        faces = divide_plane(np.append(lines, shapely.boundary(joined[is_cut])), 1.0)
        faces = faces[face_owners(faces, joined[is_cut]) != OUTSIDE]
        found = _cells_of(np.append(joined[~is_cut], faces))
        if found is not None and (is_cut.all() or _outer_length(found) < _outer_length(cells) + GRID):
            return found
    raise RuntimeError("faces of one subdivision overlap")


def _outer_length(cells: Cells) -> float:
    ends = cells.vertices[cells.borders[(cells.sides < 0).any(axis=1)]]
    return float(np.hypot(*(ends[:, 1] - ends[:, 0]).T).sum())


def _cells_of(polygons: NDArray[np.object_]) -> Cells | None:
    polygons = polygons[np.lexsort(shapely.bounds(polygons).T[::-1])]
    graph = graph_of(polygons, np.arange(len(polygons)))
    if graph is None:
        return None
    scale = round(1.0 / GRID)
    return Cells(polygons, graph.places / scale, graph.ends, graph.sides, shapely.area(polygons) / scale**2)


def _joined(cells: Cells, group: IntArray) -> NDArray[np.object_]:
    """Return the cells of each group, numbered from 0, as one polygon."""
    rows, first = rows_by_group(group, group.max(initial=-1) + 1)
    groups = [cells.polygons[rows[begin:end]] for begin, end in pairwise(first.tolist())]
    return np.array(
        [one[0] if len(one) == 1 else shapely.coverage_union_all(one) for one in groups], dtype=object
    )


#: A vertex nearer to the line through its neighbours than this is no corner [steps of the grid].
_STRAIGHT = 4.0


def face_corners(cells: Cells, face: IntArray, outline: Outline) -> IntArray:
    """Return the rows of the vertices that `face_rings` has."""
    places = np.rint(cells.vertices / GRID).astype(np.int64)
    stays = np.isin(places @ (1.0, 1j), np.rint(np.concatenate(outline.rings) / GRID) @ (1.0, 1j))
    sides = np.where(cells.sides >= 0, face[cells.sides], -1)
    edges = cells.borders[sides[:, 0] != sides[:, 1]]
    goes = straight_places(places, edges, stays, _STRAIGHT)
    return np.setdiff1d(edges, np.flatnonzero(goes))


def face_rings(cells: Cells, face: IntArray, outline: Outline) -> list[tuple[FloatArray, ...]]:
    """
    Return the rings of faces, each of the cells with its number, without vertices where no edge bends.

    The outline keeps its own vertices, whatever lies around them. A face has its outer ring first, open [m];
    none if it has no corners: the solid closes such gaps.
    """
    kept = np.rint(np.concatenate(outline.rings) / GRID).astype(np.int64)
    rings = straightened_rings(_joined(cells, face), kept, _STRAIGHT)
    return [tuple(ring / round(1.0 / GRID) for ring in group) for group in rings]


def cells_of_points(cells: Cells, points: FloatArray) -> IntArray:
    """Return the cell that each point lies in, -1 for those beside the outline; they rise by y."""
    lines = cells.vertices[cells.borders].reshape(-1, 4)
    order = np.argsort(lines[:, [1, 3]].min(axis=1), kind="stable")
    return _cells_above(points, lines[order], cells.sides[order])


#: Most columns in which edges are looked up.
_MOST_COLUMNS = 1000


@kernel
def _cells_above(points, lines, sides):  # type: ignore[no-untyped-def]
    """
    Return what lies above the next edge below each point; where several start, the steepest counts.

    Points rise by y, and edges by that of their lower ends; they lead east.
    """
    west, east = np.inf, -np.inf
    for e in range(len(lines)):
        west, east = min(west, lines[e, 0]), max(east, lines[e, 2])
    n_columns = min(len(lines), _MOST_COLUMNS)
    width = (east - west) / n_columns
    spans, n = np.empty((len(lines), 2), np.int64), 0
    for e in range(len(lines)):
        spans[e, 0] = min(int((lines[e, 0] - west) / width), n_columns - 1)
        spans[e, 1] = min(int((lines[e, 2] - west) / width), n_columns - 1)
        n += spans[e, 1] - spans[e, 0] + 1
    edge, column, n = np.empty(n, np.int64), np.empty(n, np.int64), 0
    for e in range(len(lines)):
        for k in range(spans[e, 0], spans[e, 1] + 1):
            edge[n], column[n] = e, k
            n += 1
    rows, first = rows_by_group(column, n_columns)
    own_lines = lines[edge[rows]]
    # How many of a column's edges begin no higher than the point, and how high each and those before it end.
    last, top = first[:-1].copy(), np.maximum(own_lines[:, 1], own_lines[:, 3])
    for own in range(n_columns):
        for k in range(first[own] + 1, first[own + 1]):
            top[k] = max(top[k], top[k - 1])
    found = np.full(len(points), -1, np.int64)
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        if not west <= x < east:
            continue
        own, highest, steepest = min(int((x - west) / width), n_columns - 1), -np.inf, 0.0
        while last[own] < first[own + 1] and min(own_lines[last[own], 1], own_lines[last[own], 3]) <= y:
            last[own] += 1
        for k in range(last[own] - 1, first[own] - 1, -1):
            ax, ay, bx, by = own_lines[k]
            if top[k] < highest:
                break
            if not ax <= x < bx:
                continue
            slope = (by - ay) / (bx - ax)
            z = ay + slope * (x - ax)
            if z <= y and (z > highest or (z == highest and slope > steepest)):
                highest, steepest, found[i] = z, slope, sides[edge[rows[k]], 0]
    return found
