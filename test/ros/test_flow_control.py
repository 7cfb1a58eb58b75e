from dataclasses import replace

import numpy as np
import pytest

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros import flow_control
from lidar_buildings.ros.depths import FEW_POINTS, MOST_TILES
from lidar_buildings.ros.flow_control import FlowControl
from lidar_buildings.ros.playback import Playback
from lidar_buildings.ros.receipts import DONE, FAILED, TAKEN, Receipt

SECOND = 1_000_000_000
TIMEOUT = 10.0
#: Stamps of two tiles.
A, B = 1_000, 2_000


@pytest.fixture
def flow(clock):
    return FlowControl(2, timeout=TIMEOUT, max_attempts=3, now=clock)


def tile(stamp):
    return PointTile(np.zeros((1, 3)), stamp=stamp)


def stamps(flights):
    return [flight.tile.stamp for flight in flights]


def send_both(flow):
    for stamp in (A, B):
        flow.sent(tile(stamp))


def hear(flow, node, state, stamp):
    flow.hear(Receipt(node, f"life of {node}", state, stamp))


def test_no_more_tiles_than_credits_are_in_flight(flow, monkeypatch):
    monkeypatch.setattr(flow_control, "FEW_POINTS", 0)
    for stamp in (A, B):
        assert flow.has_room
        flow.sent(tile(stamp))
    assert not flow.has_room
    assert flow.done(A)
    assert flow.has_room
    assert not flow.done(A)


@pytest.mark.parametrize(
    ("limit", "share", "most"),
    [(2, 1 / 6, 6), (2, 1 / 2, 2), (2, 1 / 3, 3), (1, 1 / 6, 1), (2, 1 / 100, MOST_TILES), (4, 1, 4)],
)
def test_more_tiles_than_credits_are_in_flight_while_they_have_few_points(limit, share, most):
    flow, n_points = FlowControl(limit, TIMEOUT, 3), int(FEW_POINTS * share)
    while flow.has_room:
        flow.sent(PointTile(np.zeros((n_points, 3)), stamp=A * (1 + len(flow))))
    assert len(flow) == most


def test_without_credits_every_tile_may_go_and_none_is_waited_for(clock):
    flow = FlowControl(0, timeout=1.0, max_attempts=1, now=clock)
    flow.sent(tile(A))
    assert flow.has_room
    assert len(flow) == 0


def test_what_a_node_has_in_hand_is_never_lost_however_slow_it_is(flow, clock):
    flow.sent(tile(A))
    hear(flow, "builder", TAKEN, A)
    clock.time += 1_000_000.0
    assert not flow.has_losses
    assert flow.overdue() == flow.given_up() == []


def test_a_tile_that_waits_for_a_busy_node_is_not_lost(flow, clock):
    send_both(flow)
    hear(flow, "builder", TAKEN, A)
    hear(flow, "fitter", TAKEN, B)
    hear(flow, "fitter", DONE, B)
    clock.time += 1_000_000.0
    assert not flow.has_losses


def test_after_a_long_silence_a_tile_is_lost_and_at_last_given_up(flow, clock):
    flow.sent(tile(A))
    for wait in (TIMEOUT, 2 * TIMEOUT):
        clock.time += wait - 0.1
        assert flow.overdue() == []
        clock.time += 0.2
        assert stamps(flow.overdue()) == [A]
        assert flow.given_up() == []
    clock.time += 4 * TIMEOUT + 1.0
    assert flow.overdue() == []
    assert flow.given_up() == [A]
    assert len(flow) == 0


def test_whatever_a_node_says_ends_the_silence(flow, clock):
    flow.sent(tile(A))
    for _ in range(10):
        clock.time += 0.9 * TIMEOUT
        hear(flow, "filter", DONE, 0)
        assert not flow.has_losses


def test_what_a_node_had_in_hand_is_lost_when_it_is_started_anew_and_only_that_at_once(flow):
    send_both(flow)
    hear(flow, "fitter", TAKEN, A)
    hear(flow, "builder", TAKEN, B)
    flow.started("builder")
    assert stamps(flow.overdue()) == [B]


def test_a_tile_in_a_living_nodes_hands_is_not_sent_again_because_another_node_died(flow, clock):
    flow.sent(tile(A))
    hear(flow, "builder", TAKEN, A)
    hear(flow, "writer", TAKEN, A)
    flow.started("writer")
    clock.time += 1_000_000.0
    assert not flow.has_losses
    hear(flow, "builder", DONE, A)
    assert stamps(flow.overdue()) == [A]


def test_a_tile_on_its_way_when_a_node_was_started_is_lost_if_nothing_happens(flow, clock):
    flow.sent(tile(A))
    hear(flow, "filter", TAKEN, A)
    flow.started("writer")
    hear(flow, "filter", DONE, A)
    assert not flow.has_losses
    clock.time += 1.1
    assert stamps(flow.overdue()) == [A]


def test_a_tile_that_was_sent_before_a_node_was_known_to_all_is_soon_sent_again(flow, clock):
    flow.started("tracer")
    clock.time += 1.0
    flow.sent(tile(A))
    for _ in range(4):  # more often than a tile has attempts
        clock.time += 1.1
        assert [flight.attempt for flight in flow.overdue()] == [1]
    clock.time += TIMEOUT
    assert [flight.attempt for flight in flow.overdue()] == [1]
    clock.time += 0.9 * TIMEOUT  # all have known of each other before it was sent
    assert not flow.has_losses


def test_a_large_tile_has_longer_to_reach_a_new_node(flow, clock):
    flow.started("tracer")
    flow.sent(PointTile(np.zeros((2_000_000, 3)), stamp=A))
    clock.time += 4.9
    assert not flow.has_losses
    clock.time += 0.2
    assert stamps(flow.overdue()) == [A]


def test_a_tile_that_ends_a_node_each_time_is_given_up(flow):
    flow.sent(tile(A))
    for attempt in (2, 3):
        hear(flow, "builder", TAKEN, A)
        flow.started("builder")
        assert [flight.attempt for flight in flow.overdue()] == [attempt]
    hear(flow, "builder", TAKEN, A)
    flow.started("builder")
    assert flow.overdue() == []
    assert flow.given_up() == [A]


def test_nodes_that_start_while_a_tile_is_on_its_way_cost_it_no_attempt(flow, clock):
    flow.sent(tile(A))
    for _ in range(10):  # more often than a tile has attempts
        flow.started("writer")
        clock.time += 1.1
        assert [flight.attempt for flight in flow.overdue()] == [1]


def test_a_tile_that_a_node_could_not_handle_is_given_up_at_once(flow):
    send_both(flow)
    hear(flow, "filter", TAKEN, A)
    hear(flow, "filter", FAILED, A)
    assert flow.given_up() == [A]
    assert len(flow) == 1


def test_a_tile_is_lost_when_a_later_one_is_done(flow):
    send_both(flow)
    flow.done(B)
    assert [(flight.tile.stamp, flight.attempt) for flight in flow.overdue()] == [(A, 1)]


def test_a_tile_in_hand_when_a_later_one_is_done_is_not_lost(flow):
    send_both(flow)
    hear(flow, "builder", TAKEN, A)
    flow.done(B)
    hear(flow, "builder", DONE, A)
    assert not flow.has_losses


def test_an_earlier_tile_that_is_done_says_nothing_of_a_later_one(flow):
    send_both(flow)
    flow.done(A)
    assert not flow.has_losses


def test_a_larger_tile_takes_the_place_of_the_smaller_one_behind_all_others(flow):
    send_both(flow)
    larger = PointTile(np.zeros((5, 3)), stamp=A + 1)
    flow.sent(larger)
    flow.done(B)
    assert not flow.has_losses
    assert flow.tile(A) is larger
    assert flow.tile(5) is None


def test_a_tile_of_which_it_is_only_said_that_there_is_no_more_passes_none(flow):
    send_both(flow)
    flow.sent(replace(tile(A), bounds=None))
    assert flow.done(A)
    assert not flow.has_losses
    assert flow.overdue() == []


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


def test_it_is_told_how_it_goes(flow, clock):
    send_both(flow)
    flow.hear(Receipt("a", "life", FAILED, B))
    clock.time += 3.0
    assert flow.gauges()["silence"] == 3.0
    assert flow.given_up() == [B]
    assert (flow.gauges()["tiles_in_flight"], flow.gauges()["latency"]) == (1, 0.0)
    flow.done(A)
    told = flow.gauges()
    assert (told["tiles_in_flight"], told["tiles_done"], told["tiles_given_up"]) == (0, 1, 1)
    assert told["latency"] > 0.0
    assert told["silence"] == 0.0


def test_where_nodes_share_tiles_one_may_pass_another(flow):
    send_both(flow)
    flow.hear(Receipt("selector_1", "life", TAKEN, B, "selector", 1, 2))
    flow.hear(Receipt("selector_1", "life", DONE, B, "selector", 1, 2))
    assert flow.done(B)
    assert not flow.has_losses


def test_where_a_node_has_several_tiles_in_hand_one_may_pass_another(flow):
    send_both(flow)
    for stamp in (A, B):
        hear(flow, "selector", TAKEN, stamp)
    for stamp in (B, A):
        hear(flow, "selector", DONE, stamp)
    assert flow.done(B)
    assert not flow.has_losses
