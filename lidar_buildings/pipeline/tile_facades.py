"""A tile's façades: what its points from the street show, and of which building each is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import ON_TERRAIN, PointClass, is_of_groups
from lidar_buildings.core.model.ids import building_id
from lidar_buildings.core.model.outline import BuildingOutline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.facades.config import FacadesConfig
from lidar_buildings.core.stages.facades.facade import Facade
from lidar_buildings.core.stages.facades.finding import find_facades
from lidar_buildings.core.stages.facades.wall_map import WallMap, wall_map
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.pipeline.tile_stages import filter_ground

#: Classes of points that are no part of the scene.
_NOISE = (PointClass.LOW_NOISE, PointClass.HIGH_NOISE)
#: A façade is of a building whose outline most of it lies so near to [m]: eaves reach out that far.
_OF_OUTLINE = 1.2
#: Points under eaves lie so far before a wall, as soffits, not more than this below its top [m].
_OFF_WALL, EAVES_REACH, _BELOW_TOP = 0.1, 1.5, 1.0
#: A façade keeps no more of them.
_MOST_UNDER = 200
#: Places on a façade that are asked for the outline they lie on.
_ASKED = np.linspace(0.05, 0.95, 19)


def street_points(tile: PointTile) -> PointTile:
    """Return what of a classified tile was seen from the street, without noise."""
    return tile.select(tile.is_from_street & ~np.isin(tile.classification, _NOISE))


def find_tile_facades(
    tile: PointTile, outlines: Sequence[BuildingOutline], config: FacadesConfig
) -> tuple[Facade, ...]:
    """
    Find the façades that what `street_points` returns shows, each with its number and building.

    Those that context shows are no core. A façade's number is made from its middle as a building's id is from
    its anchor.
    """
    if not len(tile):
        return ()
    found = find_facades(
        tile.points, tile.height_above_ground, _is_ground(tile), config, is_core=tile.is_core
    )
    return tuple(_numbered(_with_eaves(_owned(found, outlines), outlines, tile.points)))


class MappedFacades(NamedTuple):
    """A tile's façades, and the plan that shows them; None if the tile has nothing to show."""

    facades: tuple[Facade, ...]
    wall_map: WallMap | None


def map_tile_facades(
    tile: PointTile, outlines: Sequence[BuildingOutline], config: FacadesConfig
) -> MappedFacades:
    """Find façades as `find_tile_facades` does, and map them."""
    facades = find_tile_facades(tile, outlines, config)
    if not len(tile):
        return MappedFacades(facades, None)
    shown = wall_map(tile.points, tile.height_above_ground, _is_ground(tile), tile.is_core, facades)
    return MappedFacades(facades, shown)


def map_road_facades(place: PointTile, config: FacadesConfig) -> MappedFacades:
    """Find and map the façades of a place beside a vehicle's way, whose ground is not known yet."""
    filtered = filter_ground(place, GroundFilterConfig()).tile
    return map_tile_facades(street_points(filtered), (), config)


def _is_ground(tile: PointTile) -> NDArray[np.bool_]:
    return is_of_groups(tile.classification, ON_TERRAIN) | (tile.classification == PointClass.GROUND)


def _owned(found: Sequence[Facade], outlines: Sequence[BuildingOutline]) -> list[Facade]:
    """Return façades with the building on whose outline most of each lies."""
    rings = np.array([shapely.boundary(one.outline.polygon) for one in outlines], dtype=object)
    owned = []
    for one in found:
        places = shapely.line_interpolate_point(shapely.LineString(one.foot), _ASKED, normalized=True)
        near = np.array([shapely.dwithin(ring, places, _OF_OUTLINE).sum() for ring in rings])
        if len(near) and 2 * near.max() > len(places):
            number = outlines[int(np.argmax(near))].building_id
            one = replace(one, building_id=number)
        owned.append(one)
    return owned


def _with_eaves(
    found: Sequence[Facade], outlines: Sequence[BuildingOutline], points: NDArray[np.float64]
) -> list[Facade]:
    """Return façades with some of the points before them, near their top, under their building's roof."""
    roofs = {one.building_id: one.outline.polygon for one in outlines}
    above = points[points[:, 2] >= min((one.top for one in found), default=0.0) - _BELOW_TOP]
    above = above[np.argsort(above[:, 0], kind="stable")]
    with_points = []
    for one in found:
        if one.building_id in roofs:
            low, high = one.foot.min(axis=0) - EAVES_REACH, one.foot.max(axis=0) + EAVES_REACH
            near = above[slice(*np.searchsorted(above[:, 0], (low[0], high[0])))]
            is_beside = (near[:, 1] >= low[1]) & (near[:, 1] <= high[1])
            near = near[is_beside & (near[:, 2] >= one.top - _BELOW_TOP)]
            places, line = shapely.points(near[:, :2]), shapely.LineString(one.foot)
            away = shapely.distance(line, places)
            under = near[
                (away >= _OFF_WALL)
                & (away <= EAVES_REACH)
                & shapely.contains_xy(roofs[one.building_id], near[:, 0], near[:, 1])
            ]
            under = under[np.lexsort(under.T)][:: 1 + len(under) // _MOST_UNDER]
            one = replace(one, under_eaves=under)
        with_points.append(one)
    return with_points


def _numbered(found: Sequence[Facade]) -> list[Facade]:
    """Return façades with numbers of their own, where two middles share a cell with the next free one."""
    taken: set[int] = set()
    numbered = []
    for one in found:
        middle = shapely.line_interpolate_point(shapely.LineString(one.foot), 0.5, normalized=True)
        number = building_id(np.array([middle.x, middle.y]))
        while number in taken:
            number = number % 0xFFFFFFFF + 1
        taken.add(number)
        numbered.append(replace(one, facade_id=number))
    return numbered
