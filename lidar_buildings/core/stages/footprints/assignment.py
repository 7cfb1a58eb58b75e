"""Which points of a tile belong to which of the given footprints, and which footprints to the tile."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.model.classes import Facade, PointClass
from lidar_buildings.core.model.ids import anchor_row
from lidar_buildings.core.model.outline import BuildingOutline
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.model.sides import NONE, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.footprints.config import FootprintConfig
from lidar_buildings.core.stages.footprints.footprints import Footprints, last_polygon_around

#: Classes of what may be a building that was not recognised as one.
_STANDING = (0, 1, PointClass.LOW_VEGETATION, PointClass.MEDIUM_VEGETATION, PointClass.HIGH_VEGETATION)
#: With a smaller share of roof points among those that stand within a footprint, all that stand are taken.
_MIN_ROOF_SHARE = 0.2
#: How near points must lie around a footprint that holds none for it to be inside the data [m].
_SEARCH_DISTANCE = 5.0
#: So many last returns are enough to do without the others.
_MIN_LAST = 3
#: Points so much farther away than the nearest one still tell of the ground at a footprint [m].
_GROUND_RING = 1.0
#: Smallest side of a cell [m], and its side for sparse points [spacings]: a roof leaves no such cell empty.
_CELL, _CELL_SPACINGS = 1.0, 2.0
_EIGHT = np.ones((3, 3), dtype=bool)


@dataclass(frozen=True, eq=False)
class AssignedPoints:
    """The footprints of a tile and their points."""

    building_id: NDArray[np.uint32]  #: 0 for points of no footprint of this tile, shape (n_points,)
    outlines: tuple[BuildingOutline, ...]  #: the footprints of this tile as they are given, by rising id
    clipped: Sides  #: on which sides one of them reaches beyond the tile's `bounds`


def assign_footprints(
    tile: PointTile, footprints: Footprints, config: FootprintConfig | None = None
) -> AssignedPoints:
    """
    Find a tile's footprints and give their points, classified and with heights, their building's id.

    A footprint's points are the roof points within it, and where these leave a gap what stands there: points
    undecided, of vegetation or façades. Where roof points are next to none, all that stands within it is
    taken, of last returns if there are any. Where footprints lie over each other, the smaller one has the
    points. A footprint belongs to the tile that holds the westernmost of all points within it as a core
    point, or of those around it if there are none within.
    """
    config = config or FootprintConfig()
    building_id = np.zeros(len(tile), dtype=np.uint32)
    if not len(tile) or not len(footprints):
        return AssignedPoints(building_id, (), NONE)
    places = footprints.touching(_box(tile.points, _SEARCH_DISTANCE))
    owner = last_polygon_around(tile.points[:, :2], [footprints.outlines[row].polygon for row in places])
    is_core, is_roof, stands = tile.is_core, tile.is_roof, _may_stand(tile, config.min_height)
    tile_spacing = tile.point_spacing
    outlines, clipped = [], NONE
    surroundings = _Surroundings(tile.points, _SEARCH_DISTANCE)
    for place, rows in zip(places, _rows_of(owner, len(places)), strict=True):
        outline, number = footprints.outlines[place], int(footprints.building_id[place])
        near = rows if len(rows) else surroundings.rows_around(outline.polygon)
        if not len(near) or not is_core[near[anchor_row(tile.points[near])]]:
            continue
        reach = 0.0 if len(rows) else _SEARCH_DISTANCE
        low, high = footprints.bounds[place].reshape(2, 2)
        clipped |= Sides.passed(low, high, tile.bounds, reach)
        chosen = _building_rows(tile, rows, is_roof[rows], stands[rows], tile_spacing, config)
        building_id[chosen] = number
        next_to_it = rows if len(rows) else surroundings.nearest(near, outline.polygon)
        ground = _ground_elevation(tile, next_to_it)
        outlines.append(BuildingOutline(number, outline, ground))
    outlines.sort(key=lambda one: one.building_id)
    return AssignedPoints(building_id, tuple(outlines), clipped)


def remark_on_points(building: PointTile) -> str:
    """Say how many of a building's points are no roof points; nothing if all are."""
    n_others = int(np.count_nonzero(~building.is_roof))
    if not n_others:
        return ""
    return f"{n_others} of {len(building)} points are what stands in the footprint where no roof points are"


class _Surroundings:
    """Finds the points around a place, up to a distance."""

    def __init__(self, points: NDArray[np.float64], distance: float) -> None:
        self._points, self._distance = points, distance
        self._order: NDArray[np.intp] | None = None

    def rows_around(self, polygon: shapely.Polygon) -> NDArray[np.intp]:
        """
        Return the points near a polygon that has some on all sides, none for one beyond the points' edge.
        """
        if self._order is None:
            self._order = np.argsort(self._points[:, 0], kind="stable")
            self._x = self._points[self._order, 0]
        west, south, east, north = polygon.buffer(self._distance).bounds
        rows = self._order[np.searchsorted(self._x, west) : np.searchsorted(self._x, east, side="right")]
        rows = rows[(self._points[rows, 1] >= south) & (self._points[rows, 1] <= north)]
        near = shapely.points(self._points[rows, :2])
        rows = np.sort(rows[shapely.dwithin(near, polygon, self._distance)])
        hull = shapely.convex_hull(shapely.multipoints(self._points[rows, :2]))
        return rows if hull.contains(polygon.centroid) else rows[:0]

    def nearest(self, rows: NDArray[np.intp], polygon: shapely.Polygon) -> NDArray[np.intp]:
        """Return those of some points that are next to a polygon."""
        distance = shapely.distance(shapely.points(self._points[rows, :2]), polygon)
        return rows[distance <= distance.min() + _GROUND_RING]


def _box(points: NDArray[np.float64], margin: float) -> tuple[float, float, float, float]:
    (west, south), (east, north) = extent_of(points)[:, :2].tolist()
    return west - margin, south - margin, east + margin, north + margin


def _rows_of(owner: NDArray[np.int32], n_owners: int) -> list[NDArray[np.intp]]:
    order = np.argsort(owner, kind="stable")
    return np.split(order, np.searchsorted(owner[order], np.arange(n_owners)))[1:]


def _may_stand(tile: PointTile, min_height: float) -> NDArray[np.bool_]:
    """Tell which points may be a building that was not recognised: undecided, vegetation or façade."""
    if tile.classification is None or tile.height_above_ground is None:
        return np.zeros(len(tile), dtype=bool)
    is_facade = (tile.classification == PointClass.BUILDING) & ~tile.is_roof
    is_candidate = np.isin(tile.classification, _STANDING) | is_facade
    return is_candidate & (tile.height_above_ground >= min_height)


def _building_rows(
    tile: PointTile,
    rows: NDArray[np.intp],
    is_roof: NDArray[np.bool_],
    stands: NDArray[np.bool_],
    spacing: float | None,
    config: FootprintConfig,
) -> NDArray[np.intp]:
    """Return those of the points within a footprint that are its building."""
    n_roof, n_standing = int(np.count_nonzero(is_roof)), int(np.count_nonzero(stands))
    if not n_standing:
        return rows[is_roof]
    if n_roof < _MIN_ROOF_SHARE * (n_roof + n_standing):
        return rows[is_roof | _last_ones(tile, rows, stands)]
    # walls and branches have roof points beside them, parts that were not recognised have none
    counted = np.flatnonzero(is_roof | stands)
    xy = tile.points[rows[counted], :2]
    is_gap = in_gaps(xy, is_roof[counted], spacing, config.min_gap_area)
    if tile.facade is not None:
        is_gap &= tile.facade[rows[counted]] != Facade.BARE  # no part of a roof that was seen
    return rows[counted[is_roof[counted] | is_gap]]


def _last_ones(tile: PointTile, rows: NDArray[np.intp], stands: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return those of the standing points that are last returns, or all where these are too few."""
    if tile.return_number is None or tile.number_of_returns is None:
        return stands
    last = stands & (tile.return_number[rows] >= tile.number_of_returns[rows])
    return last if np.count_nonzero(last) >= _MIN_LAST else stands


def _ground_elevation(tile: PointTile, rows: NDArray[np.intp]) -> float | None:
    """
    Return the lowest ground under some points [m] as a message carries it, None where no heights are known.
    """
    if tile.height_above_ground is None:
        return None
    return float(np.float32(np.min(tile.points[rows, 2] - tile.height_above_ground[rows])))


def in_gaps(
    xy: NDArray[np.float64], is_roof: NDArray[np.bool_], spacing: float | None, min_area: float
) -> NDArray[np.bool_]:
    """
    Tell which points of a footprint lie where roof points are missing, in places of some extent.

    Cells that hold points, but neither roof points nor a neighbour with such, are gathered; where enough hang
    together, `min_area` without the rim, they and the cells without roof points around them are a gap. Cells
    are aligned to the map's origin.
    """
    side = max(_CELL, _CELL_SPACINGS * (spacing or 0.0))
    cells = np.floor(xy / side).astype(np.int64)
    cells -= cells.min(axis=0) - 1
    shape = tuple(cells.max(axis=0) + 2)
    column, row = cells.T
    roof, held = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
    roof[column[is_roof], row[is_roof]] = True
    held[column, row] = True
    number, n_gaps = ndimage.label(held & ~ndimage.binary_dilation(roof, _EIGHT), _EIGHT)
    n_cells = np.bincount(number.ravel(), minlength=n_gaps + 1)
    is_large = n_cells * side**2 >= min_area
    is_large[0] = False
    gaps = ndimage.binary_dilation(is_large[number], _EIGHT) & ~roof
    inside: NDArray[np.bool_] = gaps[column, row]
    return inside
