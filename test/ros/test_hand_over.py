"""Nodes of one process hand tiles and rings over as they are; others get messages, and nobody gets both."""

import threading
import time

import numpy as np
import pytest
from geometry_msgs.msg import PolygonInstanceStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from support.node_bench import running, wait_until

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.ros import hand_over
from lidar_buildings.ros.point_cloud import from_message, to_message
from lidar_buildings.ros.polygons import ring_messages
from lidar_buildings.ros.qos import BUILDING, CLOUD
from lidar_buildings.ros.stage_node import StageNode

pytestmark = pytest.mark.graph

RINGS = {4: (np.arange(9.0).reshape(3, 3), np.arange(12.0).reshape(4, 3)), 7: (np.zeros((3, 3)),)}


#: Of their own: whoever listens to points elsewhere in the domain would have them sent as messages.
NAMESPACE = "hand_over"


class Sender(StageNode):
    def __init__(self, **kwargs):
        super().__init__("sender", {}, namespace=NAMESPACE, **kwargs)
        self.tiles, self.rings = self.create_tile_outlet("points"), self.create_ring_outlet("rings")
        self.lines = self.create_message_outlet(String, "lines", BUILDING)


class Receiver(StageNode):
    def __init__(self, **kwargs):
        super().__init__("receiver", {}, namespace=NAMESPACE, **kwargs)
        self.tiles, self.rings, self.lines, self.threads = [], [], [], set()
        self.subscribe_messages(String, "lines", lambda line: self.lines.append(line.data), BUILDING)
        self.subscribe_rings("rings", lambda stamp, rings: self.rings.append((stamp, rings)))
        self.subscribe_tiles("points", self.on_tile)

    def on_tile(self, tile):
        self.tiles.append(tile)
        self.threads.add(threading.current_thread().name)


def tile(second):
    return PointTile(np.ones((3, 3)) * second, stamp=second * 1_000_000_000, point_spacing=0.5)


@pytest.fixture
def pair(context):
    sender, receiver = Sender(context=context), Receiver(context=context)
    with running(sender, receiver):
        yield sender, receiver


def test_within_a_process_a_tile_and_rings_come_as_they_are_without_a_message(pair, monkeypatch):
    monkeypatch.setattr(hand_over, "publish_all", None)
    sender, receiver = pair
    sent = [tile(second) for second in (1, 2, 3)]
    for one in sent:
        sender.tiles.publish(one.stamp, one)
    sender.rings.publish(5, RINGS)
    wait_until(lambda: len(receiver.tiles) == 3 and receiver.rings)
    assert all(one is other for one, other in zip(receiver.tiles, sent, strict=True))
    assert receiver.rings == [(5, RINGS)]
    assert receiver.threads == {"receiver"}


def test_a_listener_that_is_no_stage_gets_messages_and_the_stage_works_once(pair, context):
    sender, receiver = pair
    tool, clouds, polygons = StageNode("tool", {}, namespace=NAMESPACE, context=context), [], []
    tool.create_subscription(PointCloud2, "points", clouds.append, CLOUD)
    tool.create_subscription(PolygonInstanceStamped, "rings", polygons.append, BUILDING)
    with running(tool):
        for second in (1, 2):
            sender.tiles.publish(tile(second).stamp, tile(second))
        sender.rings.publish(5, RINGS)
        wait_until(lambda: len(clouds) == 2 and len(polygons) == 4)
        # the last message that is no copy: it comes after the copies of the others
        publisher = sender.create_publisher(PointCloud2, "points", CLOUD)
        publisher.publish(to_message(tile(1)))
        wait_until(lambda: len(receiver.tiles) >= 3)
    assert [one.stamp // 1_000_000_000 for one in receiver.tiles] == [1, 2, 1]
    assert len(receiver.rings) == 1
    np.testing.assert_array_equal(from_message(clouds[0]).tile.points, tile(1).points)


def test_messages_of_others_come_in_where_nothing_was_handed_over(context):
    receiver, other = Receiver(context=context), Node("other", namespace=NAMESPACE, context=context)
    publishers = [
        other.create_publisher(PointCloud2, "points", CLOUD),
        other.create_publisher(PolygonInstanceStamped, "rings", BUILDING),
    ]
    with running(receiver):
        wait_until(lambda: all(one.get_subscription_count() for one in publishers))
        for _ in range(2):
            publishers[0].publish(to_message(tile(1)))
            for message in ring_messages(5, RINGS):
                publishers[1].publish(message)
        wait_until(lambda: len(receiver.tiles) == 2 and len(receiver.rings) == 2)
    other.destroy_node()


def test_lines_come_once_in_their_order_with_or_without_another_listener(pair, context, monkeypatch):
    sender, receiver = pair
    with monkeypatch.context() as patch:
        patch.setattr(hand_over, "publish_all", None)
        sender.lines.publish(1, [String(data="a"), String(data="b")])
        wait_until(lambda: len(receiver.lines) == 2)
    heard = []
    other = StageNode("other", {}, namespace=NAMESPACE, context=context)
    other.create_subscription(String, "lines", lambda message: heard.append(message.data), BUILDING)
    with running(other):
        wait_until(lambda: sender.count_subscribers("lines") == 2)
        sender.lines.publish(2, (String(data=text) for text in "cd"))
        wait_until(lambda: len(heard) == 2 and len(receiver.lines) == 4)
    assert receiver.lines == ["a", "b", "c", "d"]
    assert heard == ["c", "d"]


def test_errands_of_a_node_and_its_callbacks_take_turns(context):
    node = StageNode("errand_boy", {}, namespace=NAMESPACE, context=context)
    at_work, most, n_done = [], [], [0, 0]

    def work(kind):
        at_work.append(kind)
        time.sleep(0.001)
        most.append(len(at_work))
        at_work.pop()
        n_done[kind] += 1

    node.create_timer(0.001, lambda: work(0))
    with running(node):
        for _ in range(50):
            node.errands.put(lambda: work(1))
        wait_until(lambda: n_done[0] >= 5 and n_done[1] == 50)
    assert set(most) == {1}


def test_errands_of_a_node_that_another_executor_spins_are_done(context):
    node = StageNode("errand_boy", {}, namespace=NAMESPACE, context=context)
    executor, done = SingleThreadedExecutor(context=context), []
    executor.add_node(node)
    node.errands.put(lambda: done.append(1))
    try:
        wait_until(lambda: executor.spin_once(timeout_sec=0.1) or done)
    finally:
        executor.shutdown()
        node.destroy_node()
    node.errands.put(lambda: done.append(2))
    assert done == [1]


def test_a_node_that_is_gone_gets_nothing(context):
    sender, receiver = Sender(context=context), Receiver(context=context)
    receiver.destroy_node()
    sender.tiles.publish(tile(1).stamp, tile(1))
    sender.destroy_node()
    assert receiver.tiles == []
