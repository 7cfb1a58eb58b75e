"""What the source says of a tile as a whole, and the tiles that wait for it."""

import numpy as np
import pytest
from std_msgs.msg import String

from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.model.sides import Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros import tile_info
from lidar_buildings.ros.tile_info import TileInfos, info_message

STAMP = 1_700_000_000_123_456_789


class Listener:
    """Stands for a node."""

    def __init__(self, n_publishers):
        self.n_publishers, self.warnings = n_publishers, []

    def create_subscription(self, *_, **__):
        pass

    def count_publishers(self, _):
        return self.n_publishers

    def get_logger(self):
        return self

    def warning(self, text):
        self.warnings.append(text)


def infos_of(n_publishers):
    return TileInfos(Listener(n_publishers), lambda: None)


def tile(**members):
    return PointTile([[1.0, 2.0, 3.0]], stamp=STAMP, **members)


@pytest.mark.parametrize(
    "members",
    [
        {},
        {"bounds": (-5.0, 1.0, 20.0, 30.1), "point_spacing": 0.1, "dark_limit": 91.7},
        {"bounds": (-np.inf, 1.0, 20.0, np.inf)},
    ],
)
def test_a_tile_has_what_was_sent_of_it(members):
    infos = infos_of(1)
    sent = tile(**members)
    infos.on_info(info_message(sent))
    found = infos.complete(tile())
    for name in ("bounds", "point_spacing", "dark_limit"):
        assert getattr(found, name) == getattr(sent, name)


def test_a_tile_can_grow_where_its_source_has_limits_of_it():
    infos, west_and_east = infos_of(1), Sides(west=True, east=True)
    assert not infos.can_grow(STAMP, west_and_east), "no source has it"
    for bounds, on_west, on_both in (
        ((-5.0, 1.0, 20.0, 30.1), True, True),
        ((-np.inf, 1.0, 20.0, 30.1), False, True),
        ((-np.inf, 1.0, np.inf, 30.1), False, False),
        (None, False, False),
    ):
        infos.on_info(info_message(tile(bounds=bounds)))
        assert infos.can_grow(STAMP, Sides(west=True)) == on_west
        assert infos.can_grow(STAMP, west_and_east) == on_both


def test_a_tile_waits_for_what_the_source_says_of_it_alone():
    infos = infos_of(1)
    assert not infos.is_known(STAMP, is_promised=False)
    infos.on_info(info_message(PointTile([[0.0, 0.0, 0.0]], stamp=STAMP + 1)))
    assert not infos.is_known(STAMP, is_promised=False)
    infos.on_info(info_message(tile()))
    assert infos.is_known(STAMP, is_promised=False)


def test_where_nobody_says_anything_nothing_is_waited_for():
    infos = infos_of(0)
    assert infos.is_known(STAMP, is_promised=False)
    assert infos.complete(tile(point_spacing=0.5)).point_spacing == 0.5


@pytest.mark.parametrize("n_publishers", [0, 1])
def test_a_tile_of_a_source_of_ours_waits_longer_for_a_publisher(n_publishers, monkeypatch):
    node = Listener(0)
    infos = TileInfos(node, lambda: None)
    assert not infos.is_known(STAMP, is_promised=True)
    node.n_publishers = n_publishers
    monkeypatch.setattr(tile_info, "_PATIENCE", 0.0)
    assert infos.is_known(STAMP, is_promised=True) == (n_publishers == 0)
    assert len(node.warnings) == (n_publishers == 0)


def test_what_the_source_has_no_more_in_flight_is_over():
    infos = infos_of(1)
    other = PointTile([[0.0, 0.0, 0.0]], stamp=STAMP + 5_000)
    infos.on_info(info_message(tile(), other, life="a"))
    assert not infos.is_over(STAMP)
    infos.on_info(info_message(other, life="a"))
    assert infos.is_over(STAMP)
    assert not infos.is_over(other.stamp)
    assert not infos.is_over(STAMP + 77_000), "it may still be told of"
    infos.on_info(info_message(life="b"))
    assert not infos.is_over(STAMP), "a source that was started anew knows nothing of it"


def test_an_earlier_revision_than_the_one_in_flight_is_over():
    infos, stamp = infos_of(1), STAMP // 1000 * 1000
    infos.on_info(info_message(PointTile([[0.0, 0.0, 0.0]], stamp=stamp + 2), life="a"))
    assert [infos.is_over(stamp + revision) for revision in range(4)] == [True, True, False, False]


def test_a_source_that_waits_for_no_tile_drops_none():
    infos = infos_of(1)
    infos.on_info(info_message(tile()))
    infos.on_info(info_message())
    assert not infos.is_over(STAMP)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"stamp": "x"}', "null", "[" * 9999, '{"stamp":1e999}'])
def test_a_message_that_is_not_understood_is_refused(text):
    with pytest.raises(MessageError, match="tile_info is not understood"):
        infos_of(1).on_info(String(data=text))


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ('"point_spacing": -1.0', r"point_spacing = -1\.0"),
        ('"bounds": [1.0, 2.0, 3.0]', "tile_info is not understood"),
        ('"bounds": 7', "tile_info is not understood"),
        ('"bounds": [1, 2, "x", 4]', "tile_info is not understood"),
    ],
)
def test_a_value_that_no_tile_can_have_is_named(said, why):
    def complete():
        infos = infos_of(1)
        infos.on_info(String(data=f'{{"life": "", "tiles": [{{"stamp": {STAMP}, {said}}}]}}'))
        infos.complete(tile())

    with pytest.raises(MessageError, match=why):
        complete()
