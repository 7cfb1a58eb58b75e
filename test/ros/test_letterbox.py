"""Messages that lie until their node looks, or until they are urgent."""

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import String
from support.node_bench import wait_until

from lidar_buildings.ros.letterbox import Letterbox
from lidar_buildings.ros.qos import EVENT, LATCHED_EVENT

pytestmark = pytest.mark.graph


@pytest.fixture
def node(context):
    made = Node("reader", context=context)
    yield made
    made.destroy_node()


def box_of(node, qos, is_urgent=lambda: False):
    read = []
    box = Letterbox(node, String, "news", lambda message: read.append(message.data), qos, is_urgent)
    publisher = node.create_publisher(String, "news", qos)
    return box, read, publisher


def send(publisher, *texts):
    wait_until(publisher.get_subscription_count)
    for text in texts:
        publisher.publish(String(data=text))


def test_the_executor_leaves_messages_which_a_look_reads_in_their_order(node, context):
    box, read, publisher = box_of(node, EVENT)
    bell = []
    guard = node.create_guard_condition(lambda: bell.append(1))
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    send(publisher, "one", "two", "three")
    guard.trigger()
    while not bell:
        executor.spin_once(timeout_sec=1.0)
    executor.spin_once(timeout_sec=0.0)
    assert read == []

    def all_came():
        box.look()
        return len(read) == 3

    wait_until(all_came)
    assert read == ["one", "two", "three"]
    executor.remove_node(node)


def test_what_is_urgent_wakes_the_node(node, context):
    urgent = []
    _, read, publisher = box_of(node, EVENT, lambda: bool(urgent))
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    send(publisher, "lies there")
    urgent.append(1)
    while not read:
        executor.spin_once(timeout_sec=1.0)
    assert read == ["lies there"]
    executor.remove_node(node)


def test_a_box_made_later_holds_what_is_kept_for_late_listeners(node):
    node.create_publisher(String, "news", LATCHED_EVENT).publish(String(data="before"))
    read = []
    box = Letterbox(node, String, "news", lambda message: read.append(message.data), LATCHED_EVENT)

    def has_come():
        box.look()
        return bool(read)

    wait_until(has_come)
    assert read == ["before"]


def test_what_is_urgent_waits_while_another_callback_of_the_node_runs(node):
    box, _, _ = box_of(node, EVENT, lambda: True)
    timer = node.create_timer(3600.0, lambda: None)
    group, others = box._subscription.callback_group, node.default_callback_group
    assert others.beginning_execution(timer)
    assert not group.can_execute(box._subscription)
    others.ending_execution(timer)
    assert group.can_execute(box._subscription)
