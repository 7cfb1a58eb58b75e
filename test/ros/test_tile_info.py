"""What the source says of a tile as a whole, and the tiles that wait for it."""

from unittest.mock import MagicMock, Mock

import numpy as np
import pytest
from std_msgs.msg import String

from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.model.sides import Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros.tile_info import TileInfos, info_message

STAMP = 1_700_000_000_123_456_789


class Listener:
    """Stands for a node."""

    def __init__(self, n_publishers):
        self.n_publishers, self.warnings, self.timers = n_publishers, [], []

    default_callback_group = None

    def create_subscription(self, *_, **__):
        return Mock(handle=MagicMock(**{"take_message.return_value": None}))

    def count_publishers(self, _):
        return self.n_publishers

    def get_logger(self):
        return self

    def warning(self, text):
        self.warnings.append(text)

    def create_timer(self, _, callback):
        self.timers.append(callback)
        return self

    def cancel(self):
        pass


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
    infos = TileInfos(Listener(1))
    sent = tile(**members)
    infos.on_info(info_message(sent))
    found = infos.complete(tile())
    for name in ("bounds", "point_spacing", "dark_limit"):
        assert getattr(found, name) == getattr(sent, name)


def test_what_lies_beyond_a_tile_is_known_side_by_side():
    infos, west_and_east = TileInfos(Listener(1)), Sides(west=True, east=True)
    assert not infos.is_all(STAMP, west_and_east), "nothing was said"
    for bounds, of_west, of_both in (
        ((-5.0, 1.0, 20.0, 30.1), False, False),
        ((-np.inf, 1.0, 20.0, 30.1), True, False),
        ((-np.inf, 1.0, np.inf, 30.1), True, True),
        (None, True, True),
    ):
        infos.on_info(info_message(tile(bounds=bounds)))
        assert infos.is_all(STAMP, Sides(west=True)) == of_west
        assert infos.is_all(STAMP, west_and_east) == of_both


def test_work_waits_for_its_tile_alone():
    infos, done = TileInfos(Listener(1)), []
    infos.when_known(STAMP, lambda: done.append("first"), is_promised=False)
    infos.on_info(info_message(PointTile([[0.0, 0.0, 0.0]], stamp=STAMP + 1)))
    assert done == []
    infos.on_info(info_message(tile()))
    infos.when_known(STAMP, lambda: done.append("second"), is_promised=False)
    assert done == ["first", "second"]


def test_where_nobody_says_anything_nothing_is_waited_for():
    infos, done = TileInfos(Listener(0)), []
    infos.when_known(STAMP, lambda: done.append("now"), is_promised=False)
    assert done == ["now"]
    assert infos.complete(tile(point_spacing=0.5)).point_spacing == 0.5


def test_a_tile_of_a_source_of_ours_waits_for_a_publisher_that_cannot_be_seen_yet():
    infos, done = TileInfos(Listener(0)), []
    infos.when_known(STAMP, lambda: done.append("told"), is_promised=True)
    assert done == []
    infos.on_info(info_message(tile(point_spacing=0.1)))
    assert done == ["told"]


@pytest.mark.parametrize("n_publishers", [0, 1])
def test_after_a_time_a_tile_goes_on_if_there_is_really_nobody(n_publishers):
    node, done = Listener(0), []
    infos = TileInfos(node)
    infos.when_known(STAMP, lambda: done.append("untold"), is_promised=True)
    node.n_publishers = n_publishers
    (give_up,) = node.timers
    give_up()
    assert done == ([] if n_publishers else ["untold"])
    assert len(node.warnings) == len(done)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"stamp": "x"}', "null", "[" * 9999, '{"stamp":1e999}'])
def test_a_message_that_is_not_understood_is_refused(text):
    with pytest.raises(MessageError, match="tile_info is not understood"):
        TileInfos(Listener(1)).on_info(String(data=text))


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ('"point_spacing": -1.0', r"point_spacing = -1\.0"),
        ('"bounds": [1.0, 2.0, 3.0]', "must be four"),
        ('"bounds": 7', "must be four"),
        ('"bounds": [1, 2, "x", 4]', "must be four"),
    ],
)
def test_a_value_that_no_tile_can_have_is_named(said, why):
    infos = TileInfos(Listener(1))
    infos.on_info(String(data=f'{{"stamp": {STAMP}, {said}}}'))
    with pytest.raises(MessageError, match=why):
        infos.complete(tile())
    assert not infos.is_all(STAMP, Sides(west=True)) or "bounds" not in said
