import json
from concurrent.futures import Future
from contextlib import contextmanager

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from support.node_bench import running, wait_until

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.ros.node_state import FAILED, IN_HAND, PASSED_ON, TOPIC, TileState, state_of
from lidar_buildings.ros.point_cloud import from_message, to_message
from lidar_buildings.ros.qos import CLOUD, EVENT, LATCHED, LATCHED_EVENT
from lidar_buildings.ros.stage_node import StageNode

pytestmark = pytest.mark.graph


def doubled(tile):
    return PointTile(tile.points * 2, stamp=tile.stamp)


class Doubler(StageNode):
    """Doubles every coordinate."""

    def __init__(self, **kwargs):
        super().__init__("doubler", {"ground_filter": GroundFilterConfig}, **kwargs)
        self._out = self.create_output(PointCloud2, "doubled", CLOUD)
        self.take_tiles(("points",), self.work, self.publish)
        self.subscribe_tiles("points")

    def work(self, tile):
        return self.submit(doubled, tile)

    def publish(self, stamp, tile):
        self._out.publish(to_message(tile))
        return {"doubled": len(tile)} if len(tile) > 4 else None


class Listener(StageNode):
    def __init__(self, **kwargs):
        super().__init__("listener", {"ground_filter": GroundFilterConfig}, **kwargs)
        self.tiles, self.statuses = [], []
        self.create_subscription(DiagnosticArray, "diagnostics", self.on_diagnostics, EVENT)
        self.create_subscription(PointCloud2, "doubled", self.on_cloud, CLOUD)

    def on_cloud(self, message):
        self.tiles.append(from_message(message).tile)

    def on_diagnostics(self, message):
        self.statuses += [status for status in message.status if status.name == "doubler"]


@contextmanager
def sender_of_tiles(node, listener, context):
    """Let nodes run, and give what publishes points to them."""
    with running(node, listener):
        sender = Node("sender", context=context)
        publisher = sender.create_publisher(PointCloud2, "points", CLOUD)
        wait_until(lambda: publisher.get_subscription_count() and node._out.get_subscription_count())
        yield publisher
        sender.destroy_node()


@pytest.fixture
def graph(context):
    listener = Listener(context=context)
    with sender_of_tiles(Doubler(context=context), listener, context) as publisher:
        yield publisher, listener


def tile(n, second):
    return PointTile(np.ones((n, 3)), stamp=second * 1_000_000_000)


def test_diagnostics_tell_tile_seconds_points_and_parameters(graph):
    publisher, listener = graph
    publisher.publish(to_message(tile(2, 7)))
    wait_until(lambda: listener.statuses)
    values = {pair.key: pair.value for pair in listener.statuses[0].values}
    assert values["tile"] == "7000000000"
    assert values["points"] == "2"
    assert float(values["seconds"]) >= 0.0
    assert json.loads(values["parameters"]).keys() == {"ground_filter"}


def test_points_that_are_not_finite_are_a_warning_with_their_count(graph):
    publisher, listener = graph
    message = to_message(tile(5, 9))
    np.asarray(message.data).view("<f4")[4] = np.nan
    publisher.publish(message)
    wait_until(lambda: listener.statuses and listener.tiles)
    assert listener.statuses[0].level == DiagnosticStatus.WARN
    assert listener.statuses[0].message.startswith("1 points of points were left out")
    assert len(listener.tiles[0]) == 4


def test_no_message_ends_a_node(graph):
    publisher, listener = graph
    message = to_message(tile(2, 0))
    message.header.stamp.sec, message.header.stamp.nanosec = 2**31 - 1, 2**32 - 1
    publisher.publish(message)
    message.fields = []
    publisher.publish(message)
    publisher.publish(PointCloud2(height=2**32 - 1, width=2**32 - 1))
    infos = listener.create_publisher(String, "tile_info", LATCHED)
    diagnostics = listener.create_publisher(DiagnosticArray, "diagnostics", EVENT)
    for text in (
        '{"stamp":1e999}',
        "[" * 100_000,
        '{"life":"","tiles":[{"stamp":3000000000,"bounds":null}]}',
    ):
        infos.publish(String(data=text))
    listener.on_diagnostics = None  # fails on each from now on
    diagnostics.publish(DiagnosticArray())
    publisher.publish(to_message(tile(4, 3)))
    wait_until(lambda: listener.tiles and len(listener.tiles[-1]) == 4)


def test_a_composition_ends_with_the_error_that_a_node_cannot_go_on_from(context):
    doubler, listener = Doubler(context=context), Listener(context=context)
    with running(doubler, listener) as composition:
        assert not composition.wait(listener, timeout=0.1)
        doubler.fail(OSError("disk full"))
        with pytest.raises(OSError, match="disk full"):
            composition.wait(listener, timeout=60.0)


def test_what_fails_since_ros_has_ended_is_no_failure_of_the_tile(context, capfd):
    node, work = Doubler(context=context), Future()
    node.take_tiles(("points",), lambda tile: work, node.publish)
    node.add_part(1, "points", tile(2, 0))
    rclpy.shutdown(context=context)
    work.set_exception(ZeroDivisionError())
    node._do_later()
    assert "not passed on" not in "".join(capfd.readouterr())
    node.destroy_node()


class Patient(Doubler):
    """Passes on what waits for something only once that has come."""

    def __init__(self, **kwargs):
        self.awaited = {}
        super().__init__(**kwargs)

    def work(self, tile):
        return self.awaited.setdefault(len(tile), Future())


def test_a_tile_begins_while_another_one_waits_and_may_end_before_it(context):
    patient, listener = Patient(context=context), Listener(context=context)
    with sender_of_tiles(patient, listener, context) as publisher:
        for n, second in ((2, 1), (3, 2), (4, 3)):
            publisher.publish(to_message(tile(n, second)))
        wait_until(lambda: patient.awaited.keys() == {2, 3, 4})
        assert patient.is_at_work
        assert not listener.tiles
        patient.awaited[4].set_result(tile(4, 3))
        wait_until(lambda: len(listener.statuses) == 1)
        patient.awaited[3].set_exception(ZeroDivisionError("three\nis too much"))
        wait_until(lambda: len(listener.statuses) == 2)
        patient.awaited[2].set_result(tile(2, 1))
        wait_until(lambda: len(listener.statuses) == 3 and len(listener.tiles) == 2)
    assert [len(one) for one in listener.tiles] == [4, 2]
    assert [status.message for status in listener.statuses] == [
        "done",
        "ZeroDivisionError: three is too much",
        "done",
    ]
    assert not patient.is_at_work


def test_a_copy_of_a_tile_in_hand_is_dropped_and_one_that_comes_later_is_not(context):
    patient, listener = Patient(context=context), Listener(context=context)
    with sender_of_tiles(patient, listener, context) as publisher:
        for _ in range(2):
            publisher.publish(to_message(tile(2, 1)))
        publisher.publish(to_message(tile(3, 2)))
        wait_until(lambda: patient.awaited.keys() == {2, 3})
        patient.awaited.pop(2).set_result(tile(2, 1))
        wait_until(lambda: len(listener.tiles) == 1)
        publisher.publish(to_message(tile(2, 1)))
        wait_until(lambda: 2 in patient.awaited)


def test_the_state_says_what_a_node_has_of_each_tile(context):
    patient, listener = Patient(context=context), Listener(context=context)
    states = []
    listener.create_subscription(
        String, TOPIC, lambda message: states.append(state_of(message)), LATCHED_EVENT
    )

    def last():
        return [one.tiles for one in states if one.node == "doubler"][-1:]

    with sender_of_tiles(patient, listener, context) as publisher:
        wait_until(lambda: last() == [{}])
        for n, second in ((2, 1), (3, 2)):
            publisher.publish(to_message(tile(n, second)))
        wait_until(lambda: patient.awaited.keys() == {2, 3})
        wait_until(lambda: last() == [dict.fromkeys((10**9, 2 * 10**9), TileState(IN_HAND))])
        patient.awaited[2].set_result(tile(2, 1))
        patient.awaited[3].set_exception(ZeroDivisionError("no"))
        wait_until(
            lambda: (
                last()
                == [{10**9: TileState(PASSED_ON), 2 * 10**9: TileState(FAILED, (), "ZeroDivisionError: no")}]
            )
        )
        numbers = [one.sequence for one in states if one.node == "doubler"]
        assert numbers == sorted(set(numbers))
        wait_until(lambda: len([one for one in states if one.node == "doubler"]) > len(numbers) + 2)


def test_timers_go_on_while_the_clock_of_a_recording_stands_still(context):
    simulated = rclpy.parameter.Parameter("use_sim_time", value=True)
    node, ticks = Doubler(context=context, parameter_overrides=[simulated]), []
    node.create_timer(0.01, lambda: ticks.append(node.get_clock().now().nanoseconds))
    with running(node):
        wait_until(lambda: len(ticks) > 1)
    assert set(ticks) == {0}, "no clock is there"
