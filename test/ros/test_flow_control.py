import numpy as np
import pytest

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros.flow_control import FlowControl
from lidar_buildings.ros.graph_watch import GraphWatch
from lidar_buildings.ros.playback import Playback

SECOND = 1_000_000_000


class Clock:
    def __init__(self):
        self.time = 100.0

    def __call__(self):
        return self.time


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def flow(clock):
    return FlowControl(2, timeout=10.0, max_attempts=3, now=clock)


def tile(stamp):
    return PointTile(np.zeros((1, 3)), stamp=stamp)


def stamps(flights):
    return [flight.tile.stamp for flight in flights]


def test_no_more_tiles_than_credits_are_in_flight(flow):
    for stamp in (1, 2):
        assert flow.has_room
        flow.sent(tile(stamp))
    assert not flow.has_room
    assert flow.done(1)
    assert flow.has_room
    assert not flow.done(1)


def test_without_credits_every_tile_may_go_and_none_is_waited_for(clock):
    flow = FlowControl(0, timeout=1.0, max_attempts=1, now=clock)
    flow.sent(tile(1))
    assert flow.has_room
    assert len(flow) == 0


def test_a_late_tile_gets_twice_the_time_at_each_attempt_and_is_then_given_up(flow, clock):
    flow.sent(tile(1))
    for wait in (10.0, 20.0):
        clock.time += wait - 0.1
        assert flow.overdue() == []
        clock.time += 0.2
        assert stamps(flow.overdue()) == [1]
        assert flow.given_up() == []
    clock.time += 41.0
    assert flow.overdue() == []
    assert flow.given_up() == [1]
    assert len(flow) == 0


def test_when_a_node_has_restarted_all_tiles_in_flight_are_late_at_once(flow):
    flow.sent(tile(1))
    flow.sent(tile(2))
    for _ in range(5):  # more often than a tile has attempts
        flow.expire()
        assert flow.given_up() == []
        assert stamps(flow.overdue()) == [1, 2]


def test_a_tile_that_a_node_could_not_handle_is_late_at_once(flow):
    flow.sent(tile(1))
    assert flow.failed(1)
    assert not flow.failed(2)
    assert stamps(flow.overdue()) == [1]


def test_a_larger_tile_waits_for_all_copies_of_the_smaller_one(flow, clock):
    flow.sent(tile(1))
    clock.time += 11.0
    flow.overdue()
    assert flow.clipped(1) is None
    assert flow.clipped(1) is not None
    flow.replaced(tile(1))
    assert flow.clipped(1) is not None


def test_a_copy_that_was_lost_is_waited_for_about_as_long_as_the_other_took(flow, clock):
    flow.sent(tile(1))
    clock.time += 11.0
    flow.overdue()
    clock.time += 1.0
    assert flow.clipped(1) is None
    clock.time += 1.9
    assert flow.overdue() == []
    clock.time += 2.2
    assert [flight.n_clipped for flight in flow.overdue()] == [1]


def test_a_clipped_tile_that_is_not_in_flight_is_none_of_ours(flow):
    assert flow.clipped(5) is None


def test_a_tile_is_lost_when_a_later_one_is_done(flow, clock):
    flow.sent(tile(1))
    clock.time += 0.1
    flow.sent(tile(2))
    clock.time += 0.1
    flow.done(2)
    assert flow.overdue() == []  # its last message may be on its way
    clock.time += 1.1
    assert [(flight.tile.stamp, flight.attempt) for flight in flow.overdue()] == [(1, 1)]


def test_an_earlier_tile_that_is_done_says_nothing_of_a_later_one(flow, clock):
    flow.sent(tile(1))
    clock.time += 0.1
    flow.sent(tile(2))
    flow.done(1)
    clock.time += 9.0
    assert flow.overdue() == []
    clock.time += 1.0
    assert stamps(flow.overdue()) == [2]


def test_until_something_has_come_through_tiles_are_sent_again_soon_and_for_free(clock):
    flow = FlowControl(2, timeout=120.0, max_attempts=3, now=clock)
    flow.sent(tile(1))
    for wait in (10.0, 20.0, 40.0, 80.0):
        clock.time += wait - 0.1
        assert flow.overdue() == []
        clock.time += 0.2
        assert [flight.attempt for flight in flow.overdue()] == [1]
    flow.sent(tile(2))
    flow.done(2)
    flow.sent(tile(3))
    clock.time += 119.0
    assert 3 not in stamps(flow.overdue())
    clock.time += 2.0
    assert 3 in stamps(flow.overdue())


class Endpoint:
    def __init__(self, gid, node_name="ground_filter", node_namespace="/survey"):
        self.endpoint_gid, self.node_name, self.node_namespace = [gid], node_name, node_namespace


class View:
    """Stands for a node's view of the graph."""

    def __init__(self, *endpoints):
        self.endpoints = list(endpoints)

    def get_namespace(self):
        return "/survey"

    def get_subscriptions_info_by_topic(self, topic):
        return self.endpoints


def test_a_node_that_started_is_news_once_it_has_had_time_to_find_the_others(clock):
    watch = GraphWatch(View(Endpoint(1)), ["points"], ["ground_filter"], clock)
    assert not watch.has_new_nodes()
    assert not watch.is_stable
    clock.time += 1.0
    assert watch.has_new_nodes()
    assert watch.is_stable
    clock.time += 1.0
    assert not watch.has_new_nodes()


def test_a_restarted_node_is_known_by_its_new_endpoint(clock):
    view = View(Endpoint(1))
    watch = GraphWatch(view, ["points"], ["ground_filter"], clock)
    watch.has_new_nodes()
    clock.time += 1.0
    assert watch.has_new_nodes()
    view.endpoints = [Endpoint(2)]
    clock.time += 1.0
    assert not watch.has_new_nodes()
    clock.time += 1.0
    assert watch.has_new_nodes()


def test_tools_that_listen_in_and_other_graphs_are_no_news(clock):
    view = View(Endpoint(1, node_name="rviz"), Endpoint(2, node_namespace="/other"))
    watch = GraphWatch(view, ["points"], ["ground_filter"], clock)
    for _ in range(5):
        clock.time += 1.0
        assert not watch.has_new_nodes()
        assert watch.is_stable


def test_a_recording_plays_at_a_multiple_of_its_own_speed(clock):
    playback = Playback(now=clock)
    assert playback.is_due(50 * SECOND, 2.0)
    assert not playback.is_due(54 * SECOND, 2.0)
    clock.time += 2.0
    assert playback.is_due(54 * SECOND, 2.0)
    assert playback.is_due(10 * SECOND, 2.0)
    assert playback.is_due(900 * SECOND, 0.0)


def test_a_pause_holds_tiles_back_and_a_step_lets_one_through(clock):
    playback = Playback(is_paused=True, now=clock)
    assert not playback.is_due(SECOND, 0.0)
    assert playback.step()
    assert playback.is_due(SECOND, 0.0)
    playback.sent()
    assert not playback.is_due(2 * SECOND, 0.0)
    playback.resume()
    assert playback.is_due(2 * SECOND, 0.0)
    assert not playback.step()


def test_a_recording_goes_on_from_where_it_was_paused(clock):
    playback = Playback(now=clock)
    assert playback.is_due(0, 1.0)
    playback.pause()
    clock.time += 1000.0
    playback.resume()
    assert playback.is_due(5 * SECOND, 1.0)
    assert not playback.is_due(6 * SECOND, 1.0)
