"""Models solved again from points that came after their tile: published as provisional, never written."""

import json
from dataclasses import replace

import numpy as np
import pytest
from std_msgs.msg import String
from support.node_bench import HOUSE, STAMP, feature, made, outlines, roof, wait_until

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.outline import OutlineQuality
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.nodes.map_frames import origin_message
from lidar_buildings.nodes.stage_nodes import ModelBuilder
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.polygons import outline_rings, ring_messages
from lidar_buildings.ros.text_messages import facades_message, quality_message

pytestmark = pytest.mark.graph

OK = OutlineQuality(0.1, 0.2, BuildingStatus.OK, "")
SENDS = "plane_points outlines outline_quality facade_records map_origin newer_points"


def test_points_that_come_after_a_tile_make_its_models_provisional(context, bench):
    node = made(ModelBuilder, context, **{"flow_control.publish_tile_done": True})
    other = bench(node, SENDS, "city_model tile_done")
    wait_until(lambda: node.count_publishers("newer_points"))
    other.send("map_origin", origin_message(MapFrame()))
    other.send(
        "outline_quality", quality_message(STAMP, [replace(one, quality=OK) for one in outlines(HOUSE)])
    )
    other.send("facade_records", facades_message(STAMP, ()))
    other.send("outlines", *ring_messages(STAMP, outline_rings(outlines(HOUSE))))
    house = roof(HOUSE)
    other.send("plane_points", to_message(house))
    wait_until(lambda: other.heard["tile_done"])
    other.send("newer_points", to_message(PointTile(house.points + np.array([0.5, 0.5, 0.05]))))

    def told():
        features = (json.loads(one.data) for one in list(other.heard["city_model"]))
        objects = [one for feature in features for one in feature["CityObjects"].values()]
        return [(one["attributes"].get("provisional"), one["attributes"]["n_points"]) for one in objects]

    wait_until(lambda: len(told()) == 2)
    (first, n_before), (second, n_now) = told()
    assert (first, second) == (None, True)
    assert n_now > n_before


def test_the_writer_keeps_no_provisional_model(make_live_writer):
    writer = make_live_writer()
    content = json.loads(feature(HOUSE).data)
    content["CityObjects"]["b"]["attributes"]["provisional"] = True
    provisional = String(data=json.dumps(content, separators=(",", ":")))
    writer.on_feature(feature(HOUSE))
    writer.on_feature(provisional)
    assert [*writer._features.values()] == [feature(HOUSE).data]
    writer.destroy_node()
