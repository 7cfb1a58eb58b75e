"""The edge labeller says of every tile how its roofs could be clustered."""

import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import PointCloud2

from bench.scenes import buildings as scenes
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.nodes.edge_labeller import EdgeLabeller
from lidar_buildings.ros.composition import Composition
from lidar_buildings.ros.point_cloud import from_message, to_message
from lidar_buildings.ros.qos import CLOUD, EVENT
from lidar_buildings.ros.stage_node import StageNode

pytestmark = pytest.mark.graph


class Bench(StageNode):
    """Sends roof points and hears labels and diagnostics."""

    def __init__(self, **kwargs):
        super().__init__("bench", {}, **kwargs)
        self.labelled, self.statuses = [], []
        self.to = self.create_publisher(PointCloud2, "roof_points", CLOUD)
        self.create_subscription(PointCloud2, "edge_points", self.on_cloud, CLOUD)
        self.create_subscription(DiagnosticArray, "diagnostics", self.on_diagnostics, EVENT)

    def on_cloud(self, message):
        self.labelled.append(from_message(message).tile)

    def on_diagnostics(self, message):
        self.statuses += [status for status in message.status if status.name == "edge_labeller"]


def wait_until(condition, seconds=120.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_labels_and_the_roofs_statuses_are_published_tile_by_tile(context):
    node, bench = EdgeLabeller(context=context), Bench(context=context)
    composition = Composition(node, bench)
    composition.start()
    try:
        wait_until(lambda: bench.to.get_subscription_count() and node.count_subscribers("edge_points"))
        scene = scenes.gable(density=12.0)
        roof = scene.points[scene.is_roof]
        lone = np.tile([[5.0, 5.0, 5.0]], (4, 1))
        for second, points in ((1, roof), (2, lone), (3, np.zeros((0, 3)))):
            bench.to.publish(to_message(PointTile(points, stamp=second * 1_000_000_000)))
        wait_until(lambda: len(bench.labelled) == 3 and len(bench.statuses) == 3)
    finally:
        composition.stop()
    assert [len(tile) for tile in bench.labelled] == [len(roof), 4, 0]
    assert bench.labelled[0].edge.any()
    assert not bench.labelled[0].edge.all()
    counts = [{pair.key: pair.value for pair in status.values} for status in bench.statuses]
    assert counts[0]["roofs_ok"] == "1"
    assert counts[1]["roofs_too_few_points"] == "1"
    assert not any(key.startswith("roofs_") for key in counts[2])
