"""The player against the end of a graph that is slow, forgets tiles, or asks for more of them."""

import threading
import time
from collections import Counter
from contextlib import ExitStack

import numpy as np
import pytest
from rclpy.executors import SingleThreadedExecutor
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header
from support.cloud_files import random_cloud
from support.node_bench import call, made, running, wait_until

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.sides import ALL, NONE, Sides
from lidar_buildings.io.tiling.tile_store import SpooledTile
from lidar_buildings.nodes.tile_player import TilePlayer
from lidar_buildings.ros import tile_ledger
from lidar_buildings.ros.diagnostics import ERROR
from lidar_buildings.ros.qos import EVENT, LATCHED, LATCHED_HISTORY
from lidar_buildings.ros.stage_node import StageNode
from lidar_buildings.ros.stamps import header_of, tile_of, to_stamp
from lidar_buildings.ros.tile_table import TileTable

pytestmark = pytest.mark.graph


class GraphEnd(StageNode):
    """
    Stands for a whole graph: takes tiles and says when they are done; if it holds them, after `let_go`.

    It has a tile in hand for `delay`, forgets tiles by their number so many times, and finds others too
    small.
    """

    def __init__(self, *, delay=0.0, holds=False, forgets=(), clips=(), sides=ALL, **kwargs):
        super().__init__("graph_end", {}, **kwargs)
        self.delay, self.forgets, self.clips, self.is_silent = delay, Counter(forgets), Counter(clips), False
        self._sides, self.let_go = sides, threading.Event()
        if not holds:
            self.let_go.set()
        self.received, self.done, self.failed, self.survey_done = [], [], [], []
        self.bounds = {}  # tile → limits, in the order in which they were told
        self._numbers = {}
        self._tile_done = self.create_publisher(Header, "tile_done", LATCHED_HISTORY)
        self.take_tiles(("points",), self.work, self.publish, clipped=lambda sides: sides)
        self.create_subscription(Header, "tile_failed", self.on_failed, LATCHED_HISTORY)
        self.create_subscription(Header, "survey_done", self.on_survey_done, LATCHED)
        self.subscribe_tiles("points")

    def add_part(self, stamp, topic, part):
        number = self._numbers.setdefault(tile_of(stamp), len(self._numbers) + 1)
        if self.forgets[number] > 0 or self.is_silent:
            self.received.append(part)
            self.forgets[number] -= 1
        else:
            super().add_part(stamp, topic, part)

    def work(self, tile):
        self.received.append(tile)
        return self.submit(self._kept, self._numbers[tile_of(tile.stamp)])

    def _kept(self, number):
        time.sleep(self.delay)
        assert self.let_go.wait(120.0)
        self.clips[number] -= 1
        return self._sides if self.clips[number] >= 0 else NONE

    def publish(self, stamp, _):
        self.done.append(stamp)
        self._tile_done.publish(header_of(stamp))

    def look_again(self):
        for stamp, info in self._infos._known.items():  # what its work depends on, so that none is missed
            if self.bounds.get(stamp, [0])[-1] != info["bounds"]:
                self.bounds.setdefault(stamp, []).append(info["bounds"])
        super().look_again()

    @property
    def stamps(self):
        """Stamp of each tile by its number."""
        return {number: stamp for stamp, number in self._numbers.items()}

    def on_failed(self, message):
        self.failed.append(to_stamp(message.stamp))

    def on_survey_done(self, message):
        self.survey_done.append(to_stamp(message.stamp))


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    folder = tmp_path_factory.mktemp("survey")
    random_cloud(3000, size=(99.9, 19.9, 5.0)).write(folder / "a.laz")
    return folder


@pytest.fixture
def make_player(context, survey):
    """Make a player of the survey, five tiles of 20 m."""

    def make(**parameters):
        values = {"input": [str(survey)], "tile_size": 20.0, "buffer": 2.0, "max_buffer": 8.0}
        return made(TilePlayer, context, **values | parameters)

    return make


@pytest.fixture
def play(context, make_player):
    """Play the survey to a graph's end."""

    def start(end=None, **parameters):
        player, end = make_player(**parameters), GraphEnd(context=context, **(end or {}))
        started.enter_context(running(player, end))
        return player, end

    with ExitStack() as started:
        yield start


def n_core(tiles):
    return sum(int(np.count_nonzero(tile.buffer == 0)) for tile in tiles)


def test_every_point_comes_once_as_a_core_point(play):
    player, end = play()
    wait_until(lambda: end.survey_done)
    assert n_core(end.received) == 3000
    assert len(end.received) == len({tile.stamp for tile in end.received}) == 5
    assert (player.n_done, player.tiles.tile_count) == (5, 5)
    names = {(int(s), int(i)) for tile in end.received for s, i in zip(tile.source, tile.index, strict=True)}
    assert len(names) == 3000


def test_a_slow_graph_gets_no_more_tiles_than_it_has_credits(play, monkeypatch):
    monkeypatch.setattr(tile_ledger, "FEW_POINTS", 0)
    before = []  # how many are in flight when another one is sent
    monkeypatch.setattr(TilePlayer, "before", lambda player, tile: before.append(len(player._ledger)))
    _, end = play({"holds": True}, max_tiles_in_flight=2)
    wait_until(lambda: len(before) == 2)
    end.let_go.set()
    wait_until(lambda: end.survey_done)
    assert len(end.received) == len(before) == 5
    assert max(before) == 1


def test_a_tile_that_got_lost_is_sent_again(play):
    _, end = play({"forgets": {2: 1, 4: 2}})
    wait_until(lambda: end.survey_done)
    counts = Counter(tile.stamp for tile in end.received)
    assert sorted(counts.values()) == [1, 1, 1, 2, 3]
    assert sorted(end.done) == sorted(counts)
    assert end.failed == []


def let_a_day_pass(player):
    """Let the player look at its tiles a few times."""

    def leap():
        player._time += 86_400.0

    for _ in range(3):
        until = player._time + 86_400.0 + 1.0
        player.call_soon(leap)  # its own thread counts, too
        wait_until(lambda until=until: player._time >= until)


def test_what_a_living_node_has_in_hand_is_never_sent_to_it_again(play, context):
    player, end = play({"holds": True}, max_tiles_in_flight=1)
    wait_until(lambda: end.is_at_work)
    bystander = StageNode("bystander", {}, context=context)
    bystander.is_stage = True
    with running(bystander):
        let_a_day_pass(player)
        bystander.life = "started anew"
        let_a_day_pass(player)
        end.let_go.set()
        wait_until(lambda: player.n_done == 5)
    assert sorted(Counter(tile.stamp for tile in end.received).values()) == [1] * 5


def test_what_a_node_had_in_hand_is_sent_again_when_it_is_started_anew(play):
    player, end = play({"holds": True}, max_tiles_in_flight=1)
    wait_until(lambda: end.is_at_work)

    def start_anew():  # as if the process were another one; what the first one holds is its own affair
        end.life, end.table = "started anew", TileTable()

    end.call_soon(start_anew)
    wait_until(lambda: len(end.received) == 2)
    end.let_go.set()
    wait_until(lambda: player.n_done == 5)
    assert sorted(Counter(tile.stamp for tile in end.received).values()) == [1, 1, 1, 1, 2]


def test_a_player_that_is_started_anew_only_lists_what_a_node_has_in_hand(context, make_player):
    end, first = GraphEnd(context=context, holds=True), make_player(max_tiles_in_flight=1)
    with running(end):
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(first)
        first.publish_state()
        wait_until(lambda: executor.spin_once(timeout_sec=0.1) or end.is_at_work)
        executor.remove_node(first)
        first.destroy_node()
        second = make_player(max_tiles_in_flight=1)
        with running(second):
            wait_until(lambda: len(second._ledger) == 1)
            assert [one.stamp for one in second._ledger.listed(is_adopted=True)] == [end.received[0].stamp]
            end.let_go.set()
            wait_until(lambda: second.n_done == 5)
            assert sorted(Counter(tile.stamp for tile in end.received).values()) == [1] * 5


def test_a_tile_that_a_node_cannot_handle_is_given_up_and_the_others_are_done(play, monkeypatch):
    kept = GraphEnd._kept

    def failing(end, number):
        if number == 3:
            raise ZeroDivisionError("no")
        return kept(end, number)

    monkeypatch.setattr(GraphEnd, "_kept", failing)
    player, end = play()
    wait_until(lambda: end.survey_done and end.failed)
    assert len(end.failed) == 1
    assert len(set(end.done)) == 4
    assert end.failed[0] not in end.done
    level, message, values = player.summary.state()
    assert (level, values["tiles_given_up"], values["tiles_done"]) == (ERROR, 1, 4)
    assert message.endswith("is given up: ZeroDivisionError: no")


def test_a_clipped_tile_comes_again_larger_until_there_is_no_more_of_it(play):
    _, end = play({"clips": {2: 5}}, max_attempts=1)
    wait_until(lambda: end.survey_done)
    stamp = end.stamps[2]
    copies = [tile for tile in end.received if tile_of(tile.stamp) == stamp]
    assert [tile.stamp - stamp for tile in copies] == [0, 1, 2, 3, 4], "each is a revision of its own"
    sizes = [len(tile) for tile in copies]
    assert sizes == sorted(set(sizes))
    assert len(sizes) == 5, "that there is no more of it needs no points"
    assert len({n_core([tile]) for tile in copies}) == 1
    *bounds, last = [one for revision in range(5) for one in end.bounds[stamp + revision]]
    widths = [east - west for west, _, east, _ in bounds]
    west = (2.0 / 3.0, 4.0 / 3.0, 8.0 / 3.0, 16.0 / 3.0, 8.0)
    assert widths == pytest.approx(20.0 + np.add(west, (2.0, 4.0, 8.0, 8.0, 8.0)), abs=1e-4)
    assert last is None
    assert sorted(Counter(end.done).values()) == [1] * 5


def test_of_a_side_without_more_alone_it_is_said(play):
    _, end = play({"clips": {1: 1}, "sides": Sides(west=True)})
    wait_until(lambda: end.survey_done)
    stamp = end.stamps[1]
    (bounds,) = (tile.bounds for tile in end.received if tile_of(tile.stamp) == stamp)  # no larger one came
    assert np.isfinite(bounds).all()
    assert tuple(end.bounds[stamp][-1]) == (-np.inf, *bounds[1:])
    assert sorted(Counter(end.done).values()) == [1] * 5


def test_a_restarted_player_skips_what_is_done(play, make_player):
    player, end = play({"delay": 0.05}, start_paused=True)
    player.call_soon(lambda: setattr(player, "_steps", 2))
    wait_until(lambda: len(end.done) == 2)
    second = make_player()
    with running(second):
        wait_until(lambda: end.survey_done)
        assert sorted(Counter(end.done).values()) == [1] * 5
        assert second.n_done == 5


def test_pause_step_and_resume_are_services(play, context):
    _, end = play(start_paused=True)
    caller = StageNode("caller", {}, context=context)
    with running(caller):
        time.sleep(0.3)
        assert end.received == []
        assert call(caller, "step", "tile_player").success
        wait_until(lambda: len(end.done) == 1)
        time.sleep(0.2)
        assert len(end.received) == 1
        assert call(caller, "resume", "tile_player").success
        wait_until(lambda: end.survey_done)
        answer = call(caller, "step", "tile_player")
        assert not answer.success
        assert "call pause first" in answer.message
        assert call(caller, "pause", "tile_player").success


def test_a_recording_takes_its_own_time_at_rate_one_and_the_clock_follows(play, context):
    listener = StageNode("listener", {}, context=context)
    times = []
    listener.create_subscription(
        Clock, "/clock", lambda message: times.append(to_stamp(message.clock)), EVENT
    )
    with running(listener):
        started = time.monotonic()
        _, end = play(rate=50.0, publish_clock=True)
        wait_until(lambda: end.survey_done)
        stamps = [tile.stamp for tile in end.received]
        assert time.monotonic() - started >= (max(stamps) - stamps[0]) * 1e-9 / 50.0
        wait_until(lambda: len(times) == 5)
        assert times == stamps


def test_without_credits_tiles_go_out_without_waiting(play):
    _, end = play({"delay": 0.3}, max_tiles_in_flight=0)
    wait_until(lambda: end.survey_done)
    wait_until(lambda: len(end.received) == 5)


def test_nothing_is_sent_before_someone_listens(context, make_player):
    player = make_player()
    with running(player):
        time.sleep(0.5)
        assert len(player._ledger) == 0
        end = GraphEnd(context=context)
        with running(end):
            wait_until(lambda: end.survey_done)
            assert len(end.received) == 5


def test_a_player_without_readable_input_does_not_start(context, tmp_path):
    (tmp_path / "empty.laz").write_bytes(b"")
    for given in ([str(tmp_path / "missing.laz")], [str(tmp_path / "empty.laz")], [""]):
        with pytest.raises(InputError):
            made(TilePlayer, context, input=given)


def test_an_unreadable_file_is_left_out_and_the_rest_is_played(play, survey, tmp_path):
    broken = tmp_path / "broken.laz"
    broken.write_bytes(b"LASF" + bytes(50))
    _, end = play(input=[str(broken), str(survey)])
    wait_until(lambda: end.survey_done)
    assert n_core(end.received) == 3000


def test_a_player_that_cannot_read_on_ends_with_the_reason_and_no_survey_is_done(play, monkeypatch):
    read, n_read = SpooledTile.read, Counter()

    def failing(tile):
        n_read["tiles"] += 1
        if n_read["tiles"] == 3:
            raise OSError("the disk is gone")
        return read(tile)

    monkeypatch.setattr(SpooledTile, "read", failing)
    player, end = play()
    wait_until(player.outcome.done)
    assert "the disk is gone" in str(player.outcome.exception())
    assert end.survey_done == []
    assert len(end.received) <= 2
