"""A node under test, another that sends to it and hears it, and tiles that are made up."""

import json
from contextlib import contextmanager

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.parameter import Parameter
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from std_srvs.srv import Trigger
from support.waiting import wait_until

from lidar_buildings.commands.live_publisher import message_class
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.nodes.table import topics_called
from lidar_buildings.ros import qos
from lidar_buildings.ros.composition import Composition
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.polygons import outline_rings, ring_messages
from lidar_buildings.ros.stage_node import StageNode
from lidar_buildings.ros.stamps import to_stamp
from lidar_buildings.ros.text_messages import facades_message, tile_closing_message
from lidar_buildings.ros.tile_info import info_message

STAMP = 77_000_000_000
HOUSE, SHED = 11, 12


def made(kind, context, **parameters):
    """Make a node with some parameters."""
    overrides = [Parameter(name, value=value) for name, value in parameters.items()]
    return kind(context=context, parameter_overrides=overrides)


@contextmanager
def running(*nodes):
    """Let nodes run, each in a thread of its own, until the block ends."""
    composition = Composition(*nodes)
    composition.start()
    try:
        yield composition
    finally:
        composition.stop()


def kind_and_profile(name):
    """Message class and quality of service of a topic of the graph."""
    topic = topics_called(name)[0]
    return message_class(topic.type), getattr(qos, topic.qos)


class Bench(StageNode):
    """Sends topics (their names, with spaces between) to the node under test and hears what it publishes."""

    def __init__(self, sends, hears, **kwargs):
        super().__init__("bench", {}, **kwargs)
        self.heard = {topic: [] for topic in hears.split()}
        self.to = {topic: self.publisher_of(topic) for topic in sends.split()}
        self.hearing = []
        for topic, messages in self.heard.items():
            kind, profile = kind_and_profile(topic)
            self.hearing.append(self.create_subscription(kind, topic, messages.append, profile))
        self.told, self.info = {}, None

    def publisher_of(self, topic):
        kind, profile = kind_and_profile(topic)
        return self.create_publisher(kind, topic, profile)

    def send(self, topic, *messages):
        for message in messages:
            if isinstance(message, PointCloud2) and any(one.name == "index" for one in message.fields):
                self.tell(to_stamp(message.header.stamp))
            self.to[topic].publish(message)

    def tell(self, stamp):
        """Tell of a tile what a source tells, unless the test does."""
        if "tile_info" not in self.to and stamp not in self.told:
            self.told[stamp] = PointTile(np.zeros((1, 3)), stamp=stamp)
            self.info = self.info or self.publisher_of("tile_info")
            self.info.publish(info_message(*self.told.values()))


def roof(*building_ids, stamp=STAMP):
    """A tile with a flat roof of 5 × 5 m for each building."""
    x, y = (axis.ravel() * 1.0 for axis in np.meshgrid(np.arange(6), np.arange(6)))
    columns = [np.column_stack([x + 20 * i, y, np.full(36, 8.0)]) for i in range(len(building_ids))]
    points = np.concatenate([np.zeros((1, 3)), *columns])
    ids = np.concatenate([[0], *(np.full(36, number) for number in building_ids)]).astype(np.uint32)
    n = len(points)
    return PointTile(
        points,
        classification=np.full(n, 6),
        height_above_ground=np.full(n, 8.0),
        buffer=np.zeros(n),
        source=np.zeros(n),
        index=np.arange(n),
        edge=np.zeros(n),
        building_id=ids,
        plane_id=(ids > 0).astype(np.uint16),
        stamp=stamp,
    )


def outlines(*building_ids):
    square = np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 5.0], [0.0, 5.0]])
    return tuple(
        BuildingOutline(number, Outline(square + np.array([20.0 * i, 0.0])))
        for i, number in enumerate(building_ids)
    )


#: What the writer waits for of every tile, and what else it takes.
OF_A_TILE = "classified_points plane_points traced_outlines outlines facade_records city_model"
TO_WRITER = f"{OF_A_TILE} survey_done tile_failed"
FRAME = MapFrame("EPSG:28992", (85000.0, 447000.0, 0.0))


def feature(number):
    building = {"type": "Building", "attributes": {"building_id": number, "status": "ok"}, "geometry": []}
    content = {"type": "CityJSONFeature", "id": "b", "CityObjects": {"b": building}, "vertices": []}
    return String(data=json.dumps(content, separators=(",", ":")))


def send_tile(other, *ids, without=(), stamp=STAMP):
    """Send all that a tile's nodes say of it."""
    messages = {
        "classified_points": [to_message(roof(*ids, stamp=stamp))],
        "plane_points": [to_message(roof(*ids, stamp=stamp))],
        "traced_outlines": ring_messages(stamp, outline_rings(outlines(*ids))),
        "outlines": ring_messages(stamp, outline_rings(outlines(*ids))),
        "facade_records": [facades_message(stamp, ())],
        "city_model": [*(feature(number) for number in ids), tile_closing_message(stamp)],
    }
    for topic, content in messages.items():
        if topic not in without:
            other.send(topic, *content)


def fragments(tmp_path):
    return sorted((tmp_path / "out" / ".partial").glob("*.npz"))


def done(other):
    """Stamps of the tiles that were reported as done."""
    return [to_stamp(message.stamp) for message in other.heard["tile_done"]]


def call(other, service, node="model_writer"):
    """Answer of a service of a node."""
    client = other.create_client(Trigger, f"{node}/{service}")
    wait_until(client.service_is_ready)
    answer = client.call_async(Trigger.Request())
    wait_until(answer.done)
    return answer.result()


def told(tmp_path):
    """What ``run.json`` says, nothing if it is not there."""
    path = tmp_path / "out" / "run.json"
    return json.loads(path.read_text()) if path.exists() else {}


def warnings(other):
    """What nodes warned of in their diagnostics."""
    status = (one for message in list(other.heard["diagnostics"]) for one in message.status)
    return [one.message for one in status if one.level == DiagnosticStatus.WARN]
