"""Façades of a vehicle's way stay until their place comes again, or a tile that maps it has others."""

import numpy as np

from lidar_buildings.core.stages.facades.facade import Facade
from lidar_buildings.core.stages.facades.wall_map import WallMap
from lidar_buildings.pipeline.road_facades import RoadFacades
from lidar_buildings.pipeline.tile_facades import MappedFacades


def facade(number, x):
    foot = np.array([[x, 0.0], [x + 1.0, 0.0]])
    return Facade(foot, 0.0, 3.0, np.ones(4, dtype=bool), 0.9, 0.01, 9, 0.9, "straight", facade_id=number)


def test_a_tile_withdraws_what_places_had_and_it_has_not_and_only_once():
    kept = RoadFacades()
    kept.add([facade(1, 0.5), facade(2, 1.5), facade(3, 50.0)])
    tile = MappedFacades((), WallMap(0.5, 0.0, -5.0, 0.0, np.zeros((20, 20), dtype=np.int8)))
    assert kept.replaced(MappedFacades((), None), ()) == []
    assert kept.replaced(tile, {2}) == [1]
    assert kept.replaced(tile, ()) == []


def test_a_place_that_comes_again_withdraws_what_it_had_where_it_has_points():
    kept = RoadFacades()
    kept.add([facade(1, 0.6), facade(2, 2.6), facade(3, 50.0)])
    points = np.array([[1.2, 0.3, 2.0], [3.2, 0.3, 2.0]])
    assert kept.replaced_at(points, {2}) == [1]
    assert kept.replaced_at(points, ()) == []
    assert kept.replaced_at(points + np.array([49.0, 0.0, 0.0]), ()) == [3]
