"""A tile's buildings of which walls were seen, but not the roof over all that they enclose."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import ON_TERRAIN, Facade, PointClass, is_of_groups
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.cell_grid import cell_numbers, lowest_per_cell
from lidar_buildings.core.stages.boundary_tracing.closed_walls import (
    GROUND_CELL,
    MIN_BARE,
    WALL_CELL,
    close_walls,
)
from lidar_buildings.core.surfaces.surface_patches import connected_parts, own_roofs

#: Walls and roofs nearer to each other in plan are of one building [m].
WALL_GAP = 1.0
#: How far below the top of a wall points tell its height [m].
_TOP = 0.5


class WalledBuilding(NamedTuple):
    """A building that is closed behind its walls."""

    rows: NDArray[np.intp]  #: its roof points and the tops of its walls, rising
    outline: Outline


def roofs_and_walls(tile: PointTile) -> NDArray[np.bool_]:
    """
    Tell which points go on from the roof selection.

    They are the roofs that the tile's core may be part of, see `own_roofs`; and where walls were seen over
    which no roof was, all of the building and the ground about it, a point a cell.

    Parameters
    ----------
    tile : PointTile
        With the final classes, and what is façade.
    """
    goes_on = own_roofs(tile)
    groups = _bare_groups(tile)
    if groups:
        goes_on[np.concatenate(groups)] = True
        boxes = np.array([extent_of(tile.points[rows, :2]) for rows in groups])
        low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
        ground = np.flatnonzero(_is_ground(tile))
        ground = ground[lowest_per_cell(tile.points[ground], GROUND_CELL)]
        near = ((tile.points[ground, :2] >= low) & (tile.points[ground, :2] <= high)).all(axis=1)
        goes_on[ground[near]] = True
    return goes_on


def walled_buildings(tile: PointTile, min_area: float) -> list[WalledBuilding]:
    """
    Find the buildings of which walls were seen, but not the roof over all that they enclose.

    Parameters
    ----------
    tile : PointTile
        All points, or those of `roofs_and_walls`.
    min_area : float
        Of a building in plan [m²].
    """
    found, groups = [], _bare_groups(tile)
    ground = _cells(tile.points[_is_ground(tile)], GROUND_CELL) if groups else None
    for rows in groups:
        facade, points = tile.facade[rows], tile.points[rows]
        walls = points[facade != Facade.NONE]
        outline = close_walls(
            _cells(walls, WALL_CELL),
            _cells(points[facade == Facade.BARE], WALL_CELL),
            _cells(points[facade == Facade.NONE], GROUND_CELL),
            ground,
        )
        if outline is not None and outline.area >= min_area:
            is_told = facade == Facade.NONE
            is_told[~is_told] = _are_tops(walls)
            found.append(WalledBuilding(rows[is_told], outline))
    return found


def _bare_groups(tile: PointTile) -> list[NDArray[np.intp]]:
    """Return the rows of what hangs together in plan and has a bare wall long enough, group by group."""
    if tile.classification is None or not tile.has_bare_walls:
        return []
    bare = np.flatnonzero(tile.facade == Facade.BARE)
    wall = connected_parts(tile.points[bare], WALL_GAP, in_plan=True)
    cells = lowest_per_cell(tile.points[bare], WALL_CELL)
    is_long = np.bincount(wall[cells], minlength=wall.max() + 1) * WALL_CELL >= MIN_BARE
    if not is_long.any():
        return []
    rows = np.flatnonzero(tile.classification == PointClass.BUILDING)
    part = connected_parts(tile.points[rows], WALL_GAP, in_plan=True)
    own = np.unique(part[np.searchsorted(rows, bare[is_long[wall]])])
    chosen = np.flatnonzero(np.isin(part, own))
    chosen = chosen[np.argsort(part[chosen], kind="stable")]
    return np.split(rows[chosen], np.flatnonzero(np.diff(part[chosen])) + 1)


def _is_ground(tile: PointTile) -> NDArray[np.bool_]:
    return is_of_groups(tile.classification, ON_TERRAIN) | (tile.classification == PointClass.GROUND)


def _cells(points: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """Return the middles of the cells of a plan grid that hold points, shape (n_cells, 2) [m]."""
    return (np.floor(points[lowest_per_cell(points, size), :2] / size) + 0.5) * size


def _are_tops(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which points of walls are at their tops."""
    cell = cell_numbers(points, WALL_GAP)
    highest = np.full(cell.max() + 1, -np.inf)
    np.maximum.at(highest, cell, points[:, 2])
    return points[:, 2] >= highest[cell] - _TOP
