import numpy as np
import pytest

from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros.node_state import IN_HAND, PASSED_ON, TileState
from lidar_buildings.ros.tile_table import MAX_TILES, TileTable, agree_on_buildings


def points(*building_ids):
    return PointTile(np.zeros((len(building_ids), 3)), building_id=np.array(building_ids, dtype=np.uint32))


def outlines(*building_ids):
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    return tuple(BuildingOutline(number, Outline(square)) for number in building_ids)


@pytest.fixture
def table():
    return TileTable()


def stamps(table):
    return [one.stamp for one in table]


def test_the_latest_revision_of_a_tile_takes_the_place_of_those_before(table):
    table.entry(1000).parts["a"] = "first"
    later = table.entry(1001)
    assert (stamps(table), later.parts) == ([1001], {})
    later.parts["b"] = "first"
    assert table.entry(1000) is None
    later.parts = {}  # what was passed on may begin anew, as after a reset
    assert table.entry(1000) is not None


def test_a_revision_that_is_in_hand_stays_until_it_is_passed_on(table):
    entry = table.entry(1000)
    assert table.set(entry, TileState(IN_HAND))
    assert not table.set(entry, TileState(IN_HAND))
    table.entry(1001)
    assert not table.drop(entry)
    assert (table.in_hand, stamps(table)) == ([1000], [1000, 1001])
    table.set(entry, TileState(PASSED_ON))
    assert table.drop(entry)
    assert stamps(table) == [1001]


def test_points_without_buildings_agree_with_no_outlines():
    assert agree_on_buildings({"points": points(0, 0), "outlines": ()})
    assert not agree_on_buildings({"points": points(0, 1), "outlines": ()})


def test_points_that_know_of_no_buildings_agree_with_anything():
    assert agree_on_buildings({"points": PointTile(np.zeros((2, 3))), "outlines": outlines(1)})


def test_leftovers_of_tiles_that_came_again_do_not_pile_up(table):
    tiles = [table.entry(1000 * n) for n in range(MAX_TILES)]
    table.set(tiles[0], TileState(IN_HAND))
    table.set(tiles[7], TileState(PASSED_ON))
    for n in (MAX_TILES, MAX_TILES + 1):
        table.entry(1000 * n)
    gone = {1000 * n for n in range(MAX_TILES + 2)} - {*stamps(table)}
    assert gone == {7000, 1000}, "first what was passed on, never what is in hand"
