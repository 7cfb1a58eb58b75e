"""Pieces of a building that another tile has whole."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from lidar_buildings.core.model.outline import BuildingOutline

#: A building of which this share lies within a larger one of another tile is a piece of that one;
#: wide margin: pieces lie within it entirely, neighbours not at all.
_PIECE_SHARE = 0.5


def seam_pieces(tiles: Sequence[Sequence[BuildingOutline]]) -> set[int]:
    """
    Return the ids of buildings that are pieces of a larger building of another tile.

    Points near the edge of a tile's buffer can be judged otherwise than in the middle of the next tile, and
    a part connected by a few points then seems to be a building of its own. Buildings of one tile never
    overlap by so much and are never taken for pieces of each other; nor is a building a piece of itself, as
    another tile had it before it went over to this one.

    Parameters
    ----------
    tiles : sequence of sequences of BuildingOutline
        The buildings of each tile.
    """
    outlines = [one for tile in tiles for one in tile]
    tile_of = np.repeat(np.arange(len(tiles)), [len(tile) for tile in tiles])
    number = np.array([one.building_id for one in outlines], dtype=np.int64)
    polygons = np.array([_polygon(one) for one in outlines], dtype=object)
    area = shapely.area(polygons)
    first, second = shapely.STRtree(polygons).query(polygons)
    # by falling size; equal ones by id, so that the order of tiles does not matter
    rank = np.lexsort((number, -area)).argsort()
    chosen = (tile_of[first] != tile_of[second]) & (number[first] != number[second])
    chosen &= rank[first] > rank[second]
    smaller, larger = first[chosen], second[chosen]
    shared = shapely.area(shapely.intersection(polygons[smaller], polygons[larger]))
    is_piece = (shared >= _PIECE_SHARE * area[smaller]) & (area[smaller] > 0)
    return {outlines[row].building_id for row in smaller[is_piece]}


def _polygon(one: BuildingOutline) -> shapely.Polygon:
    """Return an outline as a valid polygon, empty where it has no ring."""
    if len(one.outline.exterior) < 3:
        return shapely.Polygon()
    holes = [hole for hole in one.outline.holes if len(hole) >= 3]
    return shapely.make_valid(shapely.Polygon(one.outline.exterior, holes))
