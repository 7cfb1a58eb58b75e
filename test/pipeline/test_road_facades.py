"""Façades of a vehicle's way stay until a tile that maps their place has others."""

import numpy as np

from lidar_buildings.core.stages.facades.facade import Facade
from lidar_buildings.core.stages.facades.wall_map import WallMap
from lidar_buildings.pipeline.road_facades import RoadFacades
from lidar_buildings.pipeline.tile_facades import MappedFacades


def facade(number, x):
    foot = np.array([[x, 0.0], [x + 1.0, 0.0]])
    return Facade(foot, 0.0, 3.0, np.ones(4, dtype=bool), 0.9, 0.01, 9, 0.9, "straight", facade_id=number)


def test_a_tile_withdraws_what_strips_had_at_its_place_and_it_has_not_and_only_once():
    kept = RoadFacades()
    kept.add([facade(1, 0.5), facade(2, 1.5), facade(3, 50.0)])
    tile = MappedFacades((), WallMap(0.5, 0.0, -5.0, 0.0, np.zeros((20, 20), dtype=np.int8)))
    assert kept.replaced(MappedFacades((), None), ()) == []
    assert kept.replaced(tile, {2}) == [1]
    assert kept.replaced(tile, ()) == []
