"""What a tile's later revision has no more is withdrawn on the topics that showed it."""

import json
from dataclasses import replace

import pytest
from support.node_bench import HOUSE, SHED, STAMP, made, outlines, roof, wait_until, warnings
from visualization_msgs.msg import Marker, MarkerArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.outline import OutlineQuality
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.nodes.map_frames import origin_message
from lidar_buildings.nodes.stage_nodes import ModelBuilder, OutlineRegulariser
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.polygons import outline_rings, outlines_of, ring_messages
from lidar_buildings.ros.qos import MAP
from lidar_buildings.ros.stage_node import StageNode
from lidar_buildings.ros.text_messages import facades_message, quality_message
from lidar_buildings.ros.tile_info import info_message

pytestmark = pytest.mark.graph

OK = OutlineQuality(0.1, 0.2, BuildingStatus.OK, "")
SENDS = "plane_points outlines outline_quality facade_records"
HEARS = "city_model building_markers tile_done diagnostics"


def rings(stamp, *ids):
    return ring_messages(stamp, outline_rings(outlines(*ids)))


def send_tile(other, stamp, *ids):
    quality = [replace(one, quality=OK) for one in outlines(*ids)]
    other.send("outline_quality", quality_message(stamp, quality))
    other.send("facade_records", facades_message(stamp, ()))
    other.send("outlines", *rings(stamp, *ids))
    other.send("plane_points", to_message(roof(*ids, stamp=stamp)))


def make_builder(context, **given):
    return made(ModelBuilder, context, **{"flow_control.publish_tile_done": True} | given)


def features(other):
    """Name and whether there is something under it, of all that came but the header."""
    lines = [json.loads(message.data) for message in list(other.heard["city_model"])]
    return [(line["id"], bool(line["CityObjects"])) for line in lines if line["type"] == "CityJSONFeature"]


def test_the_regulariser_withdraws_the_outlines_that_a_later_revision_lacks(context, bench):
    other = bench(OutlineRegulariser(context=context), "traced_outlines", "outlines")
    other.send("traced_outlines", *rings(STAMP, HOUSE, SHED))
    other.send("traced_outlines", *rings(STAMP + 1, SHED))
    other.send("traced_outlines", *rings(STAMP + 2))
    wait_until(lambda: sum(m.polygon.id == -1 for m in list(other.heard["outlines"])) == 3)
    told = [(m.polygon.id, bool(m.polygon.polygon.points)) for m in other.heard["outlines"]]
    assert told == [
        *((HOUSE, True), (SHED, True), (-1, False)),
        *((HOUSE, False), (SHED, True), (-1, False)),
        *((SHED, False), (-1, False)),
    ]


def test_the_builder_withdraws_models_and_markers_that_a_later_revision_lacks(context, bench):
    other = bench(make_builder(context), f"{SENDS} map_origin", HEARS)
    other.send("map_origin", origin_message(MapFrame()))
    for n, ids in enumerate([(HOUSE, SHED), (SHED,), (), ()], start=1):
        send_tile(other, STAMP + n, *ids)
        wait_until(lambda n=n: len(other.heard["tile_done"]) == n)
    wait_until(lambda: len(other.heard["building_markers"]) == 3)
    wait_until(lambda: (f"tile-{STAMP + 4}", False) in features(other))
    names = [name for name, is_there in features(other)[:2]]
    house, shed = names
    assert features(other) == [
        *((house, True), (shed, True), (f"tile-{STAMP + 1}", False)),
        *((shed, True), (house, False), (f"tile-{STAMP + 2}", False)),
        *((shed, False), (f"tile-{STAMP + 3}", False)),
        (f"tile-{STAMP + 4}", False),
    ]
    actions = [[(one.id, one.action) for one in m.markers] for m in other.heard["building_markers"]]
    add, delete = Marker.ADD, Marker.DELETE
    assert actions == [[(HOUSE, add), (SHED, add)], [(HOUSE, delete), (SHED, add)], [(SHED, delete)]]
    late = []
    other.create_subscription(MarkerArray, "building_markers", late.append, MAP)
    wait_until(lambda: len(late) == 3)


class Taker(StageNode):
    """Takes points and outlines, as builder and writer do."""

    def __init__(self, **kwargs):
        super().__init__("taker", {}, **kwargs)
        self.taken = []
        self.take_tiles(("outlines",), self.submit_nothing, self.publish)
        self.subscribe_rings("outlines", outlines_of)

    def submit_nothing(self, outlines):
        return self.submit(len, outlines)

    def publish(self, stamp, _):
        self.taken.append(stamp)


def test_rings_of_a_revision_that_is_over_are_dropped_as_its_points_are(context, bench):
    node = Taker(context=context)
    other = bench(node, "outlines tile_info", "")
    other.send("tile_info", info_message(roof(HOUSE), life="a"))
    wait_until(lambda: node._infos.is_known(STAMP, is_promised=True))
    other.send("tile_info", info_message(life="a"))
    wait_until(lambda: node.drops(STAMP, "outlines"))
    for stamp in (STAMP, STAMP + 1):
        other.send("outlines", *rings(stamp, HOUSE))
    wait_until(lambda: node.taken)
    assert node.taken == [STAMP + 1]


def test_a_foreign_publisher_has_his_models_though_nobody_says_where_the_map_lies(context, bench):
    other = bench(make_builder(context, **{"map_frame.frame_patience": 0.1}), SENDS, HEARS)
    send_tile(other, STAMP, HOUSE)
    wait_until(lambda: other.heard["tile_done"])
    wait_until(lambda: any(n.startswith("building-0.") for n, _ in features(other)))
    wait_until(lambda: warnings(other))
    (warning,) = set(warnings(other))
    assert warning.startswith("no map_origin was published for 0.1 s")
