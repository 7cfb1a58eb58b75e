from contextlib import ExitStack

import pytest

pytest.importorskip("rclpy")

from support.node_bench import FRAME, TO_WRITER, Bench, made, running, wait_until

from lidar_buildings.nodes.map_frames import origin_message
from lidar_buildings.nodes.model_writer import ModelWriter


@pytest.fixture
def bench(context):
    def start(node, sends, hears):
        other = Bench(sends, hears, context=context)
        started.enter_context(running(node, other))
        wait_until(lambda: all(publisher.get_subscription_count() for publisher in other.to.values()))
        wait_until(lambda: all(one.get_publisher_count() for one in other.hearing))
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
def live_bench(bench):
    """What sends to a live survey's writer, and hears it."""
    return lambda writer: bench(writer, f"{TO_WRITER} map_origin", "tile_done diagnostics")


@pytest.fixture
def live(live_bench, make_live_writer):
    """A writer that knows its frame, and what sends to it."""
    writer = make_live_writer()
    other = live_bench(writer)
    other.send("map_origin", origin_message(FRAME))
    return writer, other
