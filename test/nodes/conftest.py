import pytest

pytest.importorskip("rclpy")

from rclpy.parameter import Parameter
from support.node_bench import FRAME, LIVE_HEARS, LIVE_SENDS, Bench, wait_until

from lidar_buildings.nodes.model_writer import ModelWriter
from lidar_buildings.ros.composition import Composition
from lidar_buildings.ros.map_frames import origin_message


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


@pytest.fixture
def make_live_writer(context, tmp_path):
    def make(**given):
        values = {"output": str(tmp_path / "out"), "placed": str(tmp_path / "placed"), **given}
        return ModelWriter(
            context=context, parameter_overrides=[Parameter(k, value=v) for k, v in values.items()]
        )

    return make


@pytest.fixture
def live(bench, make_live_writer):
    """A writer that knows its frame, and what sends to it."""
    writer = make_live_writer()
    other = bench(writer, LIVE_SENDS, LIVE_HEARS)
    other.send("map_origin", origin_message(FRAME))
    return writer, other
