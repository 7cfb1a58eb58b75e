"""A tile's buildings of which walls were seen, but not the roof over all that they enclose."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.model.classes import ON_TERRAIN, FacadeClass, PointClass, is_of_groups
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.model.sides import NONE, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.cell_grid import cell_numbers, lowest_per_cell
from lidar_buildings.core.stages.boundary_tracing.closed_walls import (
    GROUND_CELL,
    MIN_BARE,
    WALL_CELL,
    close_walls,
)
from lidar_buildings.core.stages.boundary_tracing.open_ground import GROUND_REACH
from lidar_buildings.core.surfaces.surface_patches import connected_parts, own_roofs

#: Walls and roofs nearer to each other in plan hang together [m].
WALL_GAP = 1.0
#: Share of bare walls among all that hang together: with less of them the roofs were seen from above.
_MIN_BARE_SHARE = 0.1
#: How far eaves reach beyond walls [m].
_EAVES = 1.0
#: Spacing from which a tile is sparse: the disc that tells a courtyard, of 8, is wider than the smallest [m].
SPARSE = 0.375
#: How far below the top of a wall points tell its height [m].
_TOP = 0.5


def roofs_and_walls(tile: PointTile) -> NDArray[np.bool_]:
    """
    Tell which points of a tile with its final classes and façades go on from the roof selection.

    They are the roofs that the tile's core may be part of, see `own_roofs`; where walls were seen over which
    no roof was, all that hangs together with them and the ground about it; and in a tile so sparse that roofs
    are traced across courtyards and lanes, the ground about them. Of ground it is a point a cell.
    """
    goes_on, groups = own_roofs(tile), _bare_groups(tile)
    is_sparse = tile.point_spacing is not None and tile.point_spacing > SPARSE and goes_on.any()
    if not (groups or is_sparse):
        return goes_on
    ground = _Ground(tile)
    if is_sparse:
        goes_on[ground.near(tile.points[goes_on], GROUND_REACH * tile.point_spacing)] = True
    for rows in groups:
        goes_on[rows] = True
        goes_on[ground.about(tile.points[rows])] = True
    return goes_on


def walled_buildings(
    tile: PointTile, min_area: float
) -> tuple[list[tuple[NDArray[np.intp], Outline]], Sides]:
    """
    Find the buildings of which walls were seen, but not the roof over all that they enclose.

    The tile holds all points, or those of `roofs_and_walls`; `min_area` is that of a building in plan [m²].
    Returns the rows of each one's roof points and the tops of its walls, rising, and its outline; and on
    which sides walls that may be of more of them reach the tile's `bounds`.
    """
    found, clipped, groups = [], NONE, _bare_groups(tile)
    ground = _Ground(tile) if groups else None
    for rows in groups:
        points, facade = tile.points[rows], tile.facade[rows]
        is_wall = facade != FacadeClass.NONE
        cells = [_cells(points[chosen], WALL_CELL) for chosen in (is_wall, facade == FacadeClass.BARE)]
        clipped |= Sides.passed(*extent_of(points[:, :2]), tile.bounds, WALL_GAP)
        about = _middles(tile.points[ground.about(points)], GROUND_CELL)
        outlines = close_walls(*cells, _cells(points[~is_wall], GROUND_CELL), about)
        is_told = ~is_wall
        is_told[is_wall] = _are_tops(points[is_wall])
        for outline in outlines:
            own = rows[is_told & shapely.contains_xy(outline.polygon.buffer(_EAVES), points[:, :2])]
            if outline.area >= min_area and len(own):
                found.append((own, outline))
    return found, clipped


def _bare_groups(tile: PointTile) -> list[NDArray[np.intp]]:
    """Return the rows of what hangs together in plan, has bare walls enough, and part in the tile's core."""
    if tile.classification is None or not tile.has_bare_walls:
        return []
    is_building = tile.classification == PointClass.BUILDING
    bare = np.flatnonzero(is_building & (tile.facade == FacadeClass.BARE))
    if not len(bare):
        return []
    wall = connected_parts(tile.points[bare], WALL_GAP, in_plan=True)
    cells = lowest_per_cell(tile.points[bare], WALL_CELL)
    is_long = np.bincount(wall[cells], minlength=wall.max() + 1) * WALL_CELL >= MIN_BARE
    if not is_long.any():
        return []
    rows = np.flatnonzero(is_building)
    part = connected_parts(tile.points.take(rows, axis=0), WALL_GAP, in_plan=True)
    own = np.unique(part[np.searchsorted(rows, bare[is_long[wall]])])
    chosen = np.flatnonzero(np.isin(part, own))
    chosen = chosen[np.argsort(part[chosen], kind="stable")]
    groups = np.split(rows[chosen], np.flatnonzero(np.diff(part[chosen])) + 1)

    def is_bare(rows: NDArray[np.intp]) -> bool:
        walls = rows[tile.facade[rows] != FacadeClass.NONE]
        held = walls[lowest_per_cell(tile.points[walls], WALL_CELL)]
        return bool(np.mean(tile.facade[held] == FacadeClass.BARE) >= _MIN_BARE_SHARE)

    return [one for one in groups if tile.is_core[one].any() and is_bare(one)]


class _Ground:
    """Finds the ground about a place, a point for each cell that holds some, of a tile with classes."""

    def __init__(self, tile: PointTile) -> None:
        classes = tile.classification
        is_ground = is_of_groups(classes, ON_TERRAIN) | (classes == PointClass.GROUND)
        rows = np.flatnonzero(is_ground & ~tile.is_covered)
        rows = rows[lowest_per_cell(tile.points.take(rows, axis=0), GROUND_CELL)]
        self._points = _middles(tile.points.take(rows, axis=0), GROUND_CELL)
        self._rows = rows  # cell by cell, the southernmost ones first

    def about(self, points: NDArray[np.float64]) -> NDArray[np.intp]:
        """Return the ground within what walls at some points can enclose, in whatever direction they go."""
        low, high = extent_of(points[:, :2])
        middle, reach = 0.5 * (low + high), float(np.hypot(*(high - low)))
        first, last = np.searchsorted(self._points[:, 1], (middle[1] - reach, middle[1] + reach))
        near = np.abs(self._points[first:last, 0] - middle[0]) <= reach
        return self._rows[first:last][near]

    def near(self, points: NDArray[np.float64], reach: float) -> NDArray[np.intp]:
        """Return the ground within reach of some points, and some farther off [m]."""
        reach += GROUND_CELL  # places are the middles of cells
        low = points[:, :2].min(axis=0) - 2.0 * reach
        shape = ((points[:, :2].max(axis=0) - low) / reach).astype(np.int64) + 3
        is_near = np.zeros(shape, dtype=bool)
        is_near[tuple(((points[:, :2] - low) / reach).astype(np.int64).T)] = True
        is_near = ndimage.binary_dilation(is_near, np.ones((3, 3), dtype=bool))
        at = np.floor((self._points - low) / reach).astype(np.int64)
        known = ((at >= 0) & (at < shape)).all(axis=1)
        return self._rows[known][is_near[tuple(at[known].T)]]


def _middles(points: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """Return the middles of the cells of a plan grid in which points lie, shape (n, 2) [m]."""
    return (np.floor(points[:, :2] / size) + 0.5) * size


def _cells(points: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    return _middles(points[lowest_per_cell(points, size)], size)


def _are_tops(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    cell = cell_numbers(points, WALL_GAP)
    highest = np.full(cell.max() + 1, -np.inf)
    np.maximum.at(highest, cell, points[:, 2])
    return points[:, 2] >= highest[cell] - _TOP
