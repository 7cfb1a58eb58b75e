"""How well each plane fits the points over each cell."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.stages.building_model.arrangement import Cells, walls_of
from lidar_buildings.core.stages.building_model.heights import Limits
from lidar_buildings.core.stages.building_model.line_tiles import in_tiles, tile_of
from lidar_buildings.core.stages.building_model.outline_coverage import is_inside

#: Spots farther than this from any point are without data [spacings].
EMPTY_DISTANCE = 2.0
#: No point within that distance of a spot lies more cells of the raster from it: two, and one for rounding.
_REACH = 3
#: Most spots of the raster.
_MAX_SPOTS = 40_000
#: A point counts as so far off its plane at most [m].
MAX_MISFIT = 1.0
#: Misfit of a plane that is not the nearest one's where there are no points [m].
_EMPTY_MISFIT = 0.2
#: Planes steeper than this are walls [m/m]: about 83 degrees; roofing with one costs so much [m].
_MAX_RISE, _WALL_COST = 8.0, 100.0


@dataclass(frozen=True, eq=False)
class Samples:
    """
    What speaks for one plane or another over an outline.

    Attributes
    ----------
    points : ndarray of shape (n_samples, 3)
        Points; then spots without data, whose z means nothing [m].
    weight : ndarray of shape (n_samples,)
        Area that each stands for [m²].
    plane : ndarray of shape (n_samples,), int64
        Row of the plane nearest to a spot without data, -1 for points.
    """

    points: FloatArray
    weight: FloatArray
    plane: IntArray


def make_samples(
    points: FloatArray, plane_id: NDArray[np.uint16], outline: Outline, spacing: float
) -> Samples:
    """
    Weigh points by the area they stand for, and find the spots without any.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        Roof points [m].
    plane_id : ndarray of shape (n_points,)
        Number of each point's plane, 0 = none.
    outline : Outline
        Of the building [m].
    spacing : float
        Point spacing [m].
    """
    x, y = outline.exterior.T
    west, south, east, north = float(x.min()), float(y.min()), float(x.max()), float(y.max())
    step = max(spacing, ((east - west) * (north - south) / _MAX_SPOTS) ** 0.5)
    # Whole multiples of the step, so that the raster does not hang on the outline.
    column, row = math.floor(west / step), math.floor(south / step)
    n_columns, n_rows = math.floor(east / step) - column + 1, math.floor(north / step) - row + 1
    weight, spots = np.empty(len(points)), np.empty((n_columns * n_rows, 2))
    n_spots = _weigh(
        points, walls_of(outline).reshape(-1, 4), step, column - _REACH, row - _REACH, n_columns + 2 * _REACH,
        n_rows + 2 * _REACH, EMPTY_DISTANCE * spacing, weight, spots,
    )  # fmt: skip
    planar = np.flatnonzero(plane_id > 0) if n_spots else np.zeros(0, dtype=np.int64)
    no_plane = np.full(len(points), -1, dtype=np.int64)
    if not len(planar):
        return Samples(points, weight, no_plane)
    spots = spots[:n_spots]
    tree = cKDTree(points[planar, :2], balanced_tree=False, compact_nodes=False)
    label = plane_id[planar].astype(np.int64)[tree.query(spots)[1]] - 1
    return Samples(
        np.concatenate([points, np.column_stack([spots, np.zeros(n_spots)])]),
        np.concatenate([weight, np.full(n_spots, step**2)]),
        np.concatenate([no_plane, label]),
    )


@kernel
def _weigh(  # type: ignore[no-untyped-def]
    points, walls, step, column, row, n_columns, n_rows, reach, weight, spots
):  # fmt: skip
    """Write points' weights and the spots inside without a point near; return how many spots there are."""
    first = np.zeros(n_columns * n_rows + 1, np.int64)
    cell, items = np.full(len(points), -1), np.empty(len(points), np.int64)
    for i in range(len(points)):
        c, r = math.floor(points[i, 0] / step) - column, math.floor(points[i, 1] / step) - row
        if 0 <= c < n_columns and 0 <= r < n_rows:
            cell[i] = c * n_rows + r
            first[cell[i]] += 1
    for i in range(len(points)):
        # Points beside the raster count for no cell.
        weight[i] = step**2 / first[cell[i]] if cell[i] >= 0 else 0.0
    for k in range(1, len(first)):
        first[k] += first[k - 1]
    for i in range(len(points) - 1, -1, -1):
        if cell[i] >= 0:
            first[cell[i]] -= 1
            items[first[cell[i]]] = i
    first_wall, at_row = _walls_at_rows(walls, step, row, n_rows)
    n_spots = 0
    for c in range(_REACH, n_columns - _REACH):
        for r in range(_REACH, n_rows - _REACH):
            k = c * n_rows + r
            if first[k] < first[k + 1]:
                continue
            x, y = (c + column + 0.5) * step, (r + row + 0.5) * step
            is_far = True
            for turn in range(2 * _REACH + 1):
                # From the middle outwards.
                beside = c + (turn + 1) // 2 * (1 if turn % 2 else -1)
                for m in range(first[beside * n_rows + r - _REACH], first[beside * n_rows + r + _REACH + 1]):
                    i = items[m]
                    away = (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2
                    is_far = is_far and away >= reach**2
                if not is_far:
                    break
            crossed = at_row[first_wall[r] : first_wall[r + 1]]
            if is_far and is_inside(walls, crossed, len(crossed), x, y):
                spots[n_spots, 0], spots[n_spots, 1] = x, y
                n_spots += 1
    return n_spots


@inner_kernel
def _walls_at_rows(walls, step, row, n_rows):  # type: ignore[no-untyped-def]
    """Return which walls the middles of a raster's rows meet: where each row begins in them, and these."""
    first, items = np.zeros(n_rows + 1, np.int64), np.empty(0, np.int64)
    for turn in range(2):
        if turn == 1:
            for r in range(n_rows):
                first[r + 1] += first[r]
            items = np.empty(first[-1], np.int64)
        for k in range(len(walls)):
            low, high = min(walls[k, 1], walls[k, 3]), max(walls[k, 1], walls[k, 3])
            # By rounding it may be one more on either side.
            r0 = max(math.floor(low / step - 0.5) - row, 0)
            r1 = min(math.ceil(high / step - 0.5) - row, n_rows - 1)
            for r in range(r0, r1 + 1):
                if turn == 0:
                    first[r] += 1
                else:
                    first[r] -= 1
                    items[first[r]] = k
    return first, items


def cells_of_points(cells: Cells, points: FloatArray) -> IntArray:
    """
    Return the cell that each point lies in, -1 for those beside the outline.

    Parameters
    ----------
    cells : Cells
    points : ndarray of shape (n_points, 2 or more)
        [m].
    """
    # Lines that end inside a cell part nothing.
    parts = cells.sides[:, 0] != cells.sides[:, 1]
    lines = cells.vertices[cells.borders[parts]].reshape(-1, 4)
    tiles, start, items = in_tiles(lines)
    return _cells_above(points, lines, cells.sides[parts], tiles, start, items)


@kernel
def _cells_above(points, lines, sides, tiles, start, items):  # type: ignore[no-untyped-def]
    """
    Return what lies above the next edge below each point.

    The edges lead east. Tiles that none of them touches lie in one cell.
    """
    west, south, side, n_columns, n_rows = tiles[0], tiles[1], tiles[2], int(tiles[3]), int(tiles[4])
    known = np.full(len(start) - 1, -2, np.int64)
    found = np.empty(len(points), np.int64)
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        column, row = tile_of(x, west, side, n_columns), tile_of(y, south, side, n_rows)
        cell, highest, empty = -1, -np.inf, -1
        while row >= 0:
            tile = column * n_rows + row
            if start[tile] == start[tile + 1] and highest == -np.inf:
                if known[tile] != -2:
                    cell = known[tile]
                    break
                empty = tile
            for at in range(start[tile], start[tile + 1]):
                e = items[at]
                ax, bx = lines[e, 0], lines[e, 2]
                if not ax <= x < bx:
                    continue
                ay = lines[e, 1]
                z = ay + (lines[e, 3] - ay) / (bx - ax) * (x - ax)
                if highest < z <= y:
                    highest, cell = z, sides[e, 0]
            if highest >= south + row * side:
                break
            row -= 1
        if empty >= 0:
            known[empty] = cell
        found[i] = cell
    return found


def plane_costs(
    samples: Samples, cell: IntArray, cells: Cells, planes: FloatArray, limits: Limits
) -> FloatArray:
    """
    Return what it costs to roof each cell with each plane [m³], shape (n_cells, n_planes).

    That is the misfit to its samples, and how far the plane lies beyond what was seen or whether it is a
    wall. Distances are vertical and count no more than `MAX_MISFIT`, so that chimneys and antennas pull on
    no plane; spots without data speak for the nearest plane.

    Parameters
    ----------
    samples : Samples
    cell : ndarray of shape (n_samples,), int64
        The cell of each sample, -1 for none.
    cells : Cells
    planes : ndarray of shape (n_planes, 3)
        z = a·x + b·y + c.
    limits : Limits
        Of the roof.
    """
    rise = np.hypot(planes[:, 0], planes[:, 1])
    costs = np.where(rise > _MAX_RISE, _WALL_COST, 0.0) + np.zeros((len(cells), 1))
    _add_costs(
        samples.points, samples.weight, samples.plane, cell, np.ascontiguousarray(planes.T),
        cells.vertices, cells.borders, cells.sides, cells.areas,
        limits.low - limits.per_rise * rise, limits.high + limits.per_rise * rise, costs,
    )  # fmt: skip
    return costs


@kernel
def _add_costs(  # type: ignore[no-untyped-def]
    points, weight, nearest, cell, planes, vertices, borders, sides, areas, low, high, costs
):  # fmt: skip
    """Turn costs that walls have for each square metre to those of all planes."""
    n_planes = planes.shape[1]
    beyond = np.zeros(costs.shape)
    for e in range(len(borders)):
        for end in range(2):
            x, y = vertices[borders[e, end], 0], vertices[borders[e, end], 1]
            for side in range(2):
                c = sides[e, side]
                if c < 0 or sides[e, 0] == sides[e, 1]:
                    continue
                for k in range(n_planes):
                    z = planes[0, k] * x + planes[1, k] * y + planes[2, k]
                    excess = max(z - high[k], low[k] - z)
                    beyond[c, k] = excess if excess > beyond[c, k] else beyond[c, k]
    for c in range(len(costs)):
        for k in range(n_planes):
            costs[c, k] = (costs[c, k] + beyond[c, k]) * areas[c]
    for i in range(len(points)):
        c = cell[i]
        if c < 0:
            continue
        if nearest[i] >= 0:
            for k in range(n_planes):
                costs[c, k] += 0.0 if nearest[i] == k else weight[i] * _EMPTY_MISFIT
            continue
        x, y, z, w = points[i, 0], points[i, 1], points[i, 2], weight[i]
        for k in range(n_planes):
            misfit = abs(z - (planes[0, k] * x + planes[1, k] * y + planes[2, k]))
            costs[c, k] += w * (misfit if misfit < MAX_MISFIT else MAX_MISFIT)
