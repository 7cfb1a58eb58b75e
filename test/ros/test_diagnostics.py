"""How a node gets on: counts, and the level by what happened last."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from support.node_bench import running, wait_until

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.ros.diagnostics import ERROR, OK, WARN, NodeSummary, TileReport
from lidar_buildings.ros.node_state import IN_HAND, TileState
from lidar_buildings.ros.qos import EVENT
from lidar_buildings.ros.stage_node import StageNode

TILE = 1_000_000_000


@pytest.fixture
def summary(clock):
    return NodeSummary(now=clock)


def work(summary, n_points=10, seconds=0.5):
    summary.taken()
    summary.ended(n_points, seconds)


def test_tiles_points_and_seconds_are_counted(summary, clock):
    work(summary)
    summary.passed_on(4)
    clock.time += 3.0
    level, message, values = summary.state()
    assert (level, message) == (OK, "idle")
    counted = [values[name] for name in ("tiles_in", "points_in", "tiles_out", "points_out")]
    assert counted == [1, 10, 1, 4]
    assert values["input_age"] == 3.0
    work(summary, seconds=0.25)
    values = summary.state()[2]
    assert (values["seconds_last_tile"], values["seconds"]) == (0.25, 0.75)


def test_what_is_worked_on_is_said():
    _, message, values = NodeSummary(lambda: [TILE]).state()
    assert (message, values["tiles_in_hand"]) == (f"working on tile {TILE}", 1)


def test_a_warning_and_a_failed_tile_count_for_a_minute_the_worse_first(summary, clock):
    summary.failed("no disk")
    clock.time += 30.0
    summary.warned("points left out")
    assert summary.state()[:2] == (ERROR, "no disk")
    clock.time += 31.0
    assert summary.state()[:2] == (WARN, "points left out")
    clock.time += 30.0
    level, _, values = summary.state()
    assert (level, values["tiles_failed"]) == (OK, 1)


def test_silence_matters_only_while_something_is_in_flight(summary):
    gauges = {"tiles_in_flight": 0, "silence": 45.0}
    summary.gauges.append(lambda: gauges)
    assert summary.state()[0] == OK
    gauges["tiles_in_flight"] = 2
    assert summary.state()[:2] == (WARN, "no news of the tiles in flight for 45 s")


@pytest.mark.graph
def test_a_node_tells_how_it_gets_on_apart_from_its_tiles_and_at_once_when_it_cannot(context):
    worker, listener = (StageNode(name, {}, context=context) for name in ("worker", "listener"))
    heard = []

    def hear(message):
        heard.extend(one for one in message.status if one.name.startswith("worker"))

    listener.create_subscription(DiagnosticArray, "diagnostics", hear, EVENT)
    with running(listener):
        worker.table.set(worker.table.entry(TILE), TileState(IN_HAND))
        worker._diagnostics.publish_summary()
        worker._diagnostics.end_tile(TileReport(TILE, n_points=7))
        worker.summary.count_buildings(["ok", "no_solid", "ok"])
        worker.fail(OutputError("a.bag: cannot be written"))
        assert worker.outcome.exception() is not None
        wait_until(lambda: len(heard) == 3)
    worker.destroy_node()
    begun, tile, broken = heard
    assert [one.name for one in (begun, tile, broken)] == ["worker: summary", "worker", "worker: summary"]
    assert begun.message == f"working on tile {TILE}"
    assert (broken.level, broken.message) == (DiagnosticStatus.ERROR, "a.bag: cannot be written")
    values = {pair.key: pair.value for pair in broken.values}
    assert (values["points_in"], values["buildings_ok"], values["buildings_no_solid"]) == ("7", "2", "1")
    assert "tile" not in values
