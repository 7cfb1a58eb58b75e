"""A tile of very many buildings, sent to a subscriber that is busy: nothing is lost, nothing blocks."""

import os
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import PolygonInstanceStamped
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from support.waiting import wait_until

from lidar_buildings.ros.middleware import prepare_middleware
from lidar_buildings.ros.polygons import ring_message, ring_messages
from lidar_buildings.ros.qos import BUILDING
from lidar_buildings.ros.stage_node import publish_all

#: More than Fast DDS keeps unless it is told otherwise (5,000).
N_RINGS = 6_000
BUSY = 1.5
RING = np.random.default_rng(0).normal(size=(12, 3))

pytestmark = [pytest.mark.graph, pytest.mark.slow]


class Listener:
    """Is busy for a while at the first message."""

    def __init__(self, context, topic):
        self.node = rclpy.create_node("listener", context=context)
        self.ids = []
        self.hearing = self.node.create_subscription(PolygonInstanceStamped, topic, self.on_ring, BUILDING)

    def on_ring(self, message):
        if not self.ids:
            time.sleep(BUSY)
        self.ids.append(message.polygon.id)


def spin(node, context):
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    with suppress(ExternalShutdownException):
        executor.spin()


def send_burst(node, topic, is_known=lambda: None):
    publisher = node.create_publisher(PolygonInstanceStamped, topic, BUILDING)
    wait_until(publisher.get_subscription_count)
    is_known()
    publish_all(publisher, (ring_message(1, number, RING) for number in range(N_RINGS)))
    publish_all(publisher, ring_messages(1, {}))
    return publisher


def test_a_burst_of_rings_within_one_process_loses_nothing(context):
    listener = Listener(context, "rings_of_here")
    sender = rclpy.create_node("sender", context=context)
    thread = threading.Thread(target=spin, args=(listener.node, context))
    thread.start()
    send_burst(sender, "rings_of_here")
    wait_until(lambda: len(listener.ids) > N_RINGS)
    rclpy.try_shutdown(context=context)
    thread.join()
    sender.destroy_node()
    listener.node.destroy_node()
    assert listener.ids == [*range(N_RINGS), -1]


def test_a_burst_of_rings_to_another_process_loses_nothing(context):
    # Nodes of other tests may still be known for a while: a topic of theirs would have listeners at once.
    listener = Listener(context, "rings_of_another")
    root = Path(__file__).resolve().parents[2]
    path = os.pathsep.join([str(root), str(root / "test"), os.environ.get("PYTHONPATH", "")])
    child = subprocess.Popen(
        [sys.executable, __file__], stdin=subprocess.PIPE, env=os.environ | {"PYTHONPATH": path}
    )
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(listener.node)
    # What is sent before the listener, too, knows of the sender is not for it.
    wait_until(listener.hearing.get_publisher_count)
    child.stdin.write(b"both know of each other\n")
    child.stdin.flush()
    end = time.monotonic() + 240.0
    while len(listener.ids) <= N_RINGS and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.1)
    child.communicate()
    executor.shutdown()
    listener.node.destroy_node()
    assert listener.ids == [*range(N_RINGS), -1]


if __name__ == "__main__":
    prepare_middleware()
    rclpy.init()
    sending = rclpy.create_node("sender")
    kept = send_burst(sending, "rings_of_another", sys.stdin.readline)
    sys.stdin.read()  # until the test has all
    rclpy.shutdown()
