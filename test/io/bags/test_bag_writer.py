"""Bags that are written here."""

import pytest
import yaml
from rosbags.typesys import Stores, get_typestore

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.io.bags.bag import POINT, Bag
from lidar_buildings.io.bags.bag_writer import BagWriter

TYPES = get_typestore(Stores.ROS2_JAZZY).types


def point(x):
    header = TYPES["std_msgs/msg/Header"](TYPES["builtin_interfaces/msg/Time"](5, 0), "EPSG:25832")
    return TYPES[POINT](header, TYPES["geometry_msgs/msg/Point"](x, 2.0, 3.0))


def test_what_is_written_is_read_again_with_its_times(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        for number in range(3):
            bag.write("/place", POINT, 7_000 + number, point(float(number)))
    with Bag(tmp_path / "bag") as read:
        messages = list(read.messages(["/place"]))
    assert [(one.time, one.message.point.x) for one in messages] == [(7000, 0.0), (7001, 1.0), (7002, 2.0)]


def test_latched_topics_say_that_latecomers_get_them(tmp_path):
    with BagWriter(tmp_path / "bag", latched={"/map_origin"}) as bag:
        bag.write("/map_origin", POINT, 1, point(1.0))
        bag.write("/place", POINT, 1, point(1.0))
    metadata = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())
    topics = metadata["rosbag2_bagfile_information"]["topics_with_message_count"]
    said = {one["topic_metadata"]["name"]: one["topic_metadata"]["offered_qos_profiles"] for one in topics}
    assert "transient_local" in str(said["/map_origin"])
    assert not said["/place"]


def test_a_bag_does_not_replace_what_is_there(tmp_path):
    (tmp_path / "bag").write_text("mine")
    with pytest.raises(OutputError, match="bag: already exists"):
        BagWriter(tmp_path / "bag")
    assert (tmp_path / "bag").read_text() == "mine"
