import numpy as np

from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros.tile_intake import MAX_INCOMPLETE_TILES, TileJoin, agree_on_buildings


def points(*building_ids):
    return PointTile(np.zeros((len(building_ids), 3)), building_id=np.array(building_ids, dtype=np.uint32))


def outlines(*building_ids):
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    return tuple(BuildingOutline(number, Outline(square)) for number in building_ids)


def test_a_tile_is_complete_when_every_topic_has_spoken():
    join = TileJoin("ab")
    join.add(1000, "a", "first")
    join.add(2000, "b", "other")
    assert join.missing(1000) == {"b"}
    join.add(1000, "b", "second")
    assert join.missing(1000) == set()
    assert join.take(1000) == {"a": "first", "b": "second"}
    assert join.stamps() == [2000]
    assert join.missing(1000) == {"a", "b"}


def test_parts_of_two_revisions_are_not_mixed_and_the_later_one_counts():
    join = TileJoin("ab")
    for stamp, topic in ((1000, "a"), (1001, "b"), (1000, "b"), (1001, "a")):
        join.add(stamp, topic, stamp)
    assert join.stamps() == [1001]
    assert join.take(1001) == {"a": 1001, "b": 1001}


def test_parts_that_do_not_fit_wait_for_better_ones():
    join = TileJoin(("points", "outlines"), agree_on_buildings)
    join.add(1, "points", points(0, 4, 4, 9))
    join.add(1, "outlines", outlines(9))
    assert join.missing(1) == {"points", "outlines"}
    join.add(1, "outlines", outlines(4, 9))
    assert not join.missing(1)


def test_points_without_buildings_agree_with_no_outlines():
    assert agree_on_buildings({"points": points(0, 0), "outlines": ()})
    assert not agree_on_buildings({"points": points(0, 1), "outlines": ()})


def test_points_that_know_of_no_buildings_agree_with_anything():
    assert agree_on_buildings({"points": PointTile(np.zeros((2, 3))), "outlines": outlines(1)})


def test_leftovers_of_tiles_that_came_again_do_not_pile_up():
    join = TileJoin("ab")
    for stamp in range(MAX_INCOMPLETE_TILES + 1):
        join.add(1000 * stamp, "a", stamp)
    assert join.stamps() == [1000 * stamp for stamp in range(1, MAX_INCOMPLETE_TILES + 1)]
