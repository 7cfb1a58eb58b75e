import pytest

pytest.importorskip("rclpy")

import rclpy
from support.node_bench import Bench, wait_until
from support.ros_domain import use_own_domain

from lidar_buildings.ros.composition import Composition
from lidar_buildings.ros.middleware import prepare_middleware


@pytest.fixture
def context():
    use_own_domain()
    prepare_middleware()
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    yield context
    rclpy.try_shutdown(context=context)


@pytest.fixture
def bench(context):
    running = []

    def start(node, sends, hears):
        made = {topic: (kind, topic, profile) for topic, (kind, profile) in sends.items()}
        other = Bench(made, hears, context=context)
        composition = Composition(node, other)
        running.append(composition)
        composition.start()
        wait_until(lambda: all(publisher.get_subscription_count() for publisher in other.to.values()))
        wait_until(lambda: all(other.count_publishers(topic) for topic in hears))
        return other

    yield start
    for composition in running:
        composition.stop()
