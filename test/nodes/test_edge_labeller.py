"""The edge labeller says of every tile how its roofs could be clustered."""

import numpy as np
import pytest
from support.node_bench import wait_until

from bench.scenes import buildings as scenes
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.nodes.stage_nodes import EdgeLabeller
from lidar_buildings.ros.point_cloud import from_message, to_message

pytestmark = pytest.mark.graph


def test_labels_and_the_roofs_statuses_are_published_tile_by_tile(bench, context):
    other = bench(EdgeLabeller(context=context), "roof_points", "edge_points diagnostics")
    scene = scenes.gable(density=12.0)
    roof = scene.points[scene.is_roof]
    lone = np.tile([[5.0, 5.0, 5.0]], (4, 1))
    for second, points in ((1, roof), (2, lone), (3, np.zeros((0, 3)))):
        other.send("roof_points", to_message(PointTile(points, stamp=second * 1_000_000_000)))

    def statuses():
        told = (status for message in list(other.heard["diagnostics"]) for status in message.status)
        return [status for status in told if status.name == "edge_labeller"]

    wait_until(lambda: len(other.heard["edge_points"]) == len(statuses()) == 3)
    labelled = [from_message(message).tile for message in other.heard["edge_points"]]
    assert [len(tile) for tile in labelled] == [len(roof), 4, 0]
    assert labelled[0].edge.any()
    assert not labelled[0].edge.all()
    counts = [{pair.key: pair.value for pair in status.values} for status in statuses()]
    assert counts[0]["roofs_ok"] == "1"
    assert counts[1]["roofs_too_few_points"] == "1"
    assert not any(key.startswith("roofs_") for key in counts[2])
