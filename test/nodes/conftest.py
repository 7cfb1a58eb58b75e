from contextlib import ExitStack

import pytest

pytest.importorskip("rclpy")

from support.node_bench import FRAME, LIVE_HEARS, LIVE_SENDS, Bench, made, running, wait_until

from lidar_buildings.nodes.model_writer import ModelWriter
from lidar_buildings.ros.map_frames import origin_message


@pytest.fixture
def bench(context):
    def start(node, sends, hears):
        topics = {topic: (kind, topic, profile) for topic, (kind, profile) in sends.items()}
        other = Bench(topics, hears, context=context)
        started.enter_context(running(node, other))
        wait_until(lambda: all(publisher.get_subscription_count() for publisher in other.to.values()))
        wait_until(lambda: all(other.count_publishers(topic) for topic in hears))
        return other

    with ExitStack() as started:
        yield start


@pytest.fixture
def make_live_writer(context, tmp_path):
    def make(**given):
        places = {"output": str(tmp_path / "out"), "placed": str(tmp_path / "placed")}
        return made(ModelWriter, context, **places | given)

    return make


@pytest.fixture
def live(bench, make_live_writer):
    """A writer that knows its frame, and what sends to it."""
    writer = make_live_writer()
    other = bench(writer, LIVE_SENDS, LIVE_HEARS)
    other.send("map_origin", origin_message(FRAME))
    return writer, other
