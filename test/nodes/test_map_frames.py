"""Where the map lies, as messages tell it, or as it is taken where nobody does."""

import numpy as np
import pytest

from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.nodes.map_frames import FrameListener, origin_message, units_message

DUTCH = MapFrame("EPSG:28992", (85000.0, 447000.0, 0.0))
FEET = MapFrame("EPSG:2229", (1000.0, 2000.0, 0.0), 0.3048, 0.3048)


class Listener:
    """Stands for a node."""

    def __init__(self, **publishers):
        self.publishers, self.warnings, self.timers = publishers, [], []
        self.topics = {}

    def create_subscription(self, _, topic, callback, __):
        self.topics[topic] = callback

    def count_publishers(self, topic):
        return self.publishers.get(topic, 0)

    def create_timer(self, period, callback):
        self.timers.append((period, callback))
        return self

    def cancel(self):
        self.timers.clear()

    def warn(self, text):
        self.warnings.append(text)


def listener(**publishers):
    node, frames = Listener(**publishers), []
    return node, frames, FrameListener(node, frames.append, 5.0)


def test_the_frame_is_known_by_its_origin_and_units():
    node, frames, found = listener(map_units=1)
    node.topics["map_origin"](origin_message(FEET))
    assert (found.frame, frames) == (None, [])
    node.topics["map_units"](units_message(FEET))
    assert found.frame == FEET
    assert frames == [FEET]
    assert found.expect()
    assert node.timers == []


def test_a_node_does_not_wait_for_units_that_only_itself_may_tell():
    node, frames = Listener(map_units=1), []
    found = FrameListener(node, frames.append, n_own=1)
    node.topics["map_origin"](origin_message(DUTCH))
    assert found.frame == DUTCH
    assert frames == [DUTCH]


def test_where_nobody_tells_the_frame_is_taken_as_it_is_after_a_time_and_that_is_said_once():
    node, frames, found = listener()
    assert not found.expect()
    assert not found.expect()
    ((period, lose_patience),) = node.timers
    assert period == 5.0
    assert frames == []
    lose_patience()
    assert frames == [MapFrame()]
    assert found.expect()
    (said,) = node.warnings
    assert said.startswith("no map_origin was published for 5 s")
    assert node.timers == []
    # What comes later counts from then on.
    node.topics["map_origin"](origin_message(DUTCH))
    assert frames == [MapFrame(), DUTCH]
    assert found.frame == DUTCH


@pytest.mark.parametrize("silent", ["map_origin", "map_units"])
def test_who_publishes_but_says_nothing_is_waited_for_and_that_is_said_once(silent):
    node, frames, found = listener(**{silent: 1})
    if silent == "map_units":
        node.topics["map_origin"](origin_message(DUTCH))
    assert not found.expect()
    for _ in range(3):
        node.timers[0][1]()
    assert frames == []
    assert node.warnings == [f"{silent} is advertised but silent: tiles wait for it"]
    node.publishers.clear()
    node.timers[0][1]()
    assert frames == [MapFrame() if silent == "map_origin" else DUTCH]
    assert node.timers == []


def test_units_that_somebody_begins_to_publish_later_are_waited_for_too():
    node, frames, found = listener()
    node.topics["map_origin"](origin_message(FEET))
    assert found.expect()
    node.publishers["map_units"] = 1
    assert not found.expect()
    node.timers[0][1]()
    assert len(node.warnings) == 1
    node.topics["map_units"](units_message(FEET))
    assert frames[-1] == FEET
    assert node.timers == []


def test_a_frame_that_was_told_in_time_is_kept():
    node, frames, found = listener()
    found.expect()
    lose_patience = node.timers[0][1]
    node.topics["map_origin"](origin_message(DUTCH))
    lose_patience()
    assert frames == [DUTCH]
    assert node.warnings == []


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        ("map_origin", origin_message(MapFrame("map"))),
        ("map_origin", origin_message(MapFrame("EPSG:4326"))),
        ("map_origin", origin_message(MapFrame("", (np.nan, 0.0, 0.0)))),
        ("map_origin", origin_message(MapFrame("", (0.0, 1e300, 0.0)))),
        ("map_units", units_message(MapFrame(horizontal_unit=0.0))),
        ("map_units", units_message(MapFrame(vertical_unit=-np.inf))),
    ],
)
def test_what_is_no_place_and_no_unit_is_refused_and_changes_nothing(topic, message):
    node, frames, found = listener()
    node.topics["map_origin"](origin_message(DUTCH))
    with pytest.raises(MessageError):
        node.topics[topic](message)
    assert found.frame == DUTCH
    assert frames == [DUTCH]
