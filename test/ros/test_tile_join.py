import numpy as np

from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros.tile_join import MAX_INCOMPLETE_TILES, TileJoin, agree_on_buildings


def points(*building_ids):
    return PointTile(np.zeros((len(building_ids), 3)), building_id=np.array(building_ids, dtype=np.uint32))


def outlines(*building_ids):
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    return tuple(BuildingOutline(number, Outline(square)) for number in building_ids)


def test_a_tile_is_complete_when_every_topic_has_spoken():
    join = TileJoin("ab")
    assert join.add(1000, "a", "first") is None
    assert join.add(2000, "b", "other") is None
    assert join.add(1000, "b", "second") == {"a": "first", "b": "second"}
    assert join.add(1000, "b", "again") is None


def test_parts_of_two_revisions_are_not_mixed_and_the_later_one_counts():
    join = TileJoin("ab")
    assert join.add(1000, "a", "small") is None
    assert join.add(1001, "b", "large") is None
    assert join.add(1000, "b", "small") is None
    assert join.add(1001, "a", "large") == {"a": "large", "b": "large"}


def test_parts_that_do_not_fit_wait_for_better_ones():
    join = TileJoin(("points", "outlines"), agree_on_buildings)
    assert join.add(1, "points", points(0, 4, 4, 9)) is None
    assert join.add(1, "outlines", outlines(9)) is None
    assert join.add(1, "outlines", outlines(4, 9)) is not None


def test_a_complete_tile_is_held_back_until_it_is_ready():
    known = set()
    join = TileJoin("ab", is_ready=lambda stamp, parts: stamp in known)
    for stamp in (1, 2):
        assert join.add(stamp, "a", "first") is None
        assert join.add(stamp, "b", "second") is None
    assert list(join.take_ready()) == []
    known.add(2)
    assert list(join.take_ready()) == [(2, {"a": "first", "b": "second"})]
    known.add(1)
    join.add(1, "a", "sent again")
    assert join.add(1, "b", "second") == {"a": "sent again", "b": "second"}
    assert list(join.take_ready()) == []


def test_points_without_buildings_agree_with_no_outlines():
    assert agree_on_buildings({"points": points(0, 0), "outlines": ()})
    assert not agree_on_buildings({"points": points(0, 1), "outlines": ()})


def test_points_that_know_of_no_buildings_agree_with_anything():
    assert agree_on_buildings({"points": PointTile(np.zeros((2, 3))), "outlines": outlines(1)})


def test_leftovers_of_tiles_that_came_again_do_not_pile_up():
    join = TileJoin("ab")
    for stamp in range(MAX_INCOMPLETE_TILES + 1):
        join.add(1000 * stamp, "a", stamp)
    assert join.add(0, "b", 0) is None
    assert join.add(1000 * MAX_INCOMPLETE_TILES, "b", 0) is not None


def test_a_later_revision_takes_the_place_of_what_waited_and_of_what_was_incomplete():
    join = TileJoin("ab", is_ready=lambda stamp, parts: False)
    for topic in "ab":
        join.add(1000, topic, "waiting")
    join.add(1001, "a", "incomplete")
    join.add(1002, "a", "new")
    assert list(join.take_ready()) == []
    assert (join.part(1000, "a"), join.part(1001, "a"), join.part(1002, "a")) == (None, None, "new")


def test_tiles_that_never_become_ready_do_not_pile_up():
    ready = []
    join = TileJoin("a", is_ready=lambda stamp, parts: stamp in ready)
    for stamp in range(0, 1000 * (MAX_INCOMPLETE_TILES + 5), 1000):
        join.add(stamp, "a", stamp)
    ready += range(0, 1000 * (MAX_INCOMPLETE_TILES + 5), 1000)
    assert len(list(join.take_ready())) == MAX_INCOMPLETE_TILES


def test_a_tile_is_not_ready_when_the_one_before_it_took_what_it_needs():
    models = {7}
    join = TileJoin("a", is_ready=lambda stamp, parts: is_open and parts["a"] in models)
    is_open = False
    for stamp in (1000, 2000):
        join.add(stamp, "a", 7)
    is_open = True
    taken = []
    for stamp, parts in join.take_ready():
        models.discard(parts["a"])
        taken.append(stamp)
    assert taken == [1000]
    models.add(7)
    assert [stamp for stamp, _ in join.take_ready()] == [2000]
