import numpy as np
import pytest

from lidar_buildings.core.tile import PointTile
from lidar_buildings.ros.flow_control import FlowControl
from lidar_buildings.ros.playback import Playback
from lidar_buildings.ros.probes import Probes, is_probe

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


def test_what_is_older_than_something_that_came_through_was_lost(flow, clock):
    flow.sent(tile(1))
    clock.time += 1.0
    sent = clock.time
    clock.time += 1.0
    flow.sent(tile(2))
    flow.passed(sent)
    assert flow.overdue() == []  # its last message may be on its way
    clock.time += 1.5
    assert stamps(flow.overdue()) == [1]


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


def test_copies_that_were_lost_are_not_waited_for(flow, clock):
    flow.sent(tile(1))
    clock.time += 11.0
    flow.overdue()
    assert flow.clipped(1) is None
    clock.time += 1.0
    flow.passed(clock.time)
    clock.time += 2.0
    assert [flight.n_clipped for flight in flow.overdue()] == [1]


def test_a_clipped_tile_that_is_not_in_flight_is_none_of_ours(flow):
    assert flow.clipped(5) is None


def test_probes_come_often_until_one_is_answered_then_rarely(clock):
    probes = Probes(clock)
    first = probes.due()
    assert is_probe(first)
    assert probes.due() is None
    clock.time += 0.6
    assert probes.due() != first
    assert not probes.has_answer
    assert probes.answered(first) == 100.0
    assert probes.has_answer
    assert probes.due() is None


def test_a_graph_that_takes_long_to_answer_is_probed_less_often(clock):
    probes = Probes(clock)
    first = probes.due()
    clock.time += 30.0
    probes.answered(first)
    clock.time += 59.0
    assert probes.due() is None
    clock.time += 2.0
    assert probes.due() is not None


@pytest.mark.parametrize("is_whole", [False, True])
def test_unanswered_probes_do_not_pile_up(clock, is_whole):
    probes = Probes(clock)
    if is_whole:
        probes.answered(probes.due())
    sent = 0
    for _ in range(6000):
        clock.time += 0.1
        sent += probes.due() is not None
    assert 5 <= sent <= 11


def test_the_answer_to_anothers_probe_means_nothing(clock):
    probes = Probes(clock)
    assert probes.answered(123) is None
    assert not probes.has_answer


def test_no_tile_can_be_mistaken_for_a_probe():
    assert not is_probe(SECOND)
    assert not is_probe(-5)


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
