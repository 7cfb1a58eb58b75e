"""A feed through the whole graph: what comes out does not depend on which node is killed when."""

import json
import random
import time

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger
from support.node_bench import running
from support.node_processes import LAST, NodeProcesses
from support.results import assert_buildings_once, contents
from support.waiting import wait_until

from lidar_buildings.io.tiling.spool import RECORD
from lidar_buildings.nodes.graph import feed_folder, survey_nodes
from lidar_buildings.nodes.table import nodes_until
from lidar_buildings.ros.middleware import prepare_middleware
from lidar_buildings.ros.point_cloud import cloud_message
from lidar_buildings.simulation import simulate_tile

pytestmark = [pytest.mark.graph, pytest.mark.slow]

SECOND = 1_000_000_000
T0 = 1_700_000_000 * SECOND
#: Points of a scan.
N_POINTS = 2000
FEED = {"tile_size": 38.0, "buffer": 20.0, "leave_after": 1.0}
SOURCE = "scan_assembler"


@pytest.fixture(scope="module")
def scans():
    """A village as a scanner sees it that is in the map already: in the order of flight."""
    tile, _ = simulate_tile("village", 1, density=2.0)
    names = ("intensity", "return_number", "number_of_returns")
    rows = np.zeros(len(tile), [*((axis, "<f4") for axis in "xyz"), *((n, "<f4") for n in names)])
    rows["x"], rows["y"], rows["z"] = tile.points.T
    for name in names:
        rows[name] = getattr(tile, name)
    rows = rows[np.argsort(tile.gps_time, kind="stable")]
    return [
        cloud_message(T0 + k * 1_000_000, part.reshape(1, -1))
        for k, part in enumerate(np.split(rows, range(N_POINTS, len(rows), N_POINTS)))
    ]


class Driver:
    """Sends scans, and has nodes do things."""

    def __init__(self, context, namespace):
        self.node = rclpy.create_node("driver", namespace=namespace, context=context)
        self._publisher = self.node.create_publisher(PointCloud2, "scan", QoSProfile(depth=10_000))
        self._executor = rclpy.executors.SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)
        self._n_come = 0
        self.node.create_subscription(DiagnosticArray, "diagnostics", self._on_diagnostics, 100)

    def send(self, scans):
        """Send scans, the first until one has come: before the assembler knows of this node it hears none."""

        def has_come():
            self._publisher.publish(scans[0])  # copies are left out
            self._executor.spin_once(timeout_sec=0.1)
            return self._n_come

        wait_until(has_come)
        for one in scans[1:]:
            self._publisher.publish(one)
        assert self._publisher.wait_for_all_acked(Duration(seconds=240))

    def _on_diagnostics(self, message):
        for status in message.status:
            if status.name == f"{SOURCE}: summary":
                self._n_come = int({pair.key: pair.value for pair in status.values}["scans"])

    def call(self, service):
        """Call a service until it answers: one of a node that was killed is seen for a while."""
        client = self.node.create_client(Trigger, service)
        answers = []

        def is_answered():
            answers.append(client.call_async(Trigger.Request()))
            self._executor.spin_until_future_complete(answers[-1], 1.0)
            return any(one.done() and one.result().success for one in answers)

        wait_for(is_answered)


@pytest.fixture
def driver():
    prepare_middleware()
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    made = []
    yield lambda namespace: made.append(Driver(context, namespace)) or made[-1]
    for one in made:
        one.node.destroy_node()
    rclpy.try_shutdown(context=context)


def wait_for(is_so, seconds=240.0, tails=lambda: ""):
    end = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < end, tails()
        time.sleep(0.05)


def reliable(namespace):
    return {f"qos_overrides./{namespace}/scan.subscription.reliability": "reliable"}


def n_kept(output):
    log = feed_folder(output) / "points.log"
    return log.stat().st_size // RECORD.itemsize if log.exists() else 0


@pytest.fixture(scope="module")
def undisturbed(scans, tmp_path_factory):
    """What a graph in one process makes of the scans."""
    output = tmp_path_factory.mktemp("undisturbed") / "out"
    prepare_middleware()
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    nodes = survey_nodes((), str(output), source=SOURCE, settings={SOURCE: FEED}, context=context)
    with running(*nodes.values()) as composition:
        for one in scans:
            nodes[SOURCE].tiles.add_scan(one)
        nodes[SOURCE].tiles.flush()
        wait_for(lambda: composition.wait(nodes["model_writer"], 0.0) or nodes["model_writer"].last_words)
    return output


def test_a_feed_becomes_models_each_building_once(scans, undisturbed):
    assert n_kept(undisturbed) == sum(one.width for one in scans)
    assert_buildings_once(undisturbed)
    assert json.loads((undisturbed / "run.json").read_text())["n_tiles"] >= 60


def test_nodes_may_be_killed_and_the_whole_graph_restarted_while_a_feed_is_on(
    scans, undisturbed, driver, tmp_path
):
    namespace, output = "live_killed", tmp_path / "out"
    source = FEED | reliable(namespace) | {"tile_timeout": 1.0, "max_attempts": 10}
    chance = random.Random(1)
    n_points = sum(one.width for one in scans)
    with NodeProcesses([], output, namespace, tmp_path, source=SOURCE, **source) as graph:
        graph.start_all()
        own = driver(namespace)
        own.send(scans[: len(scans) // 2])
        stages = [name for name in nodes_until(LAST, SOURCE) if name != SOURCE]
        for number in range(1, 7):
            graph.wait_for_tiles(number, 240)
            name = chance.choice(stages)
            graph.kill(name)
            graph.start(name)
        own.send(scans[len(scans) // 2 :])
        wait_for(lambda: n_kept(output) == n_points, tails=graph.tails)
        for name in nodes_until(LAST, SOURCE):  # a power cut
            graph.kill(name)
        graph.start_all()
        own.call(f"{SOURCE}/flush")
        wait_for((output / "run.json").exists, tails=graph.tails)
        graph.end("model_writer")  # not in the middle of files that another call has it make
    assert contents(output) == contents(undisturbed)
