"""The recorder writes what it hears as it came, and a full disk ends the bag alone."""

import threading
from contextlib import ExitStack

import numpy as np
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int32, String
from support.cloud_files import fill_the_disk
from support.node_bench import made, running, wait_until

from lidar_buildings.core.model.errors import OutputError, ParameterError
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.io.bags.bag_writer import Recording, offered
from lidar_buildings.nodes.recorder import Recorder
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.qos import BUILDING, CLOUD, LATCHED

pytestmark = pytest.mark.graph


@pytest.fixture
def record(context, tmp_path):
    """Start a recorder of some topics beside a sender."""
    sender = Node("sender", context=context)

    def start(*topics):
        recorder = recorder_of(context, tmp_path / "bag", *topics)
        started.enter_context(running(recorder))
        return sender, recorder

    with ExitStack() as started:
        yield start
    sender.destroy_node()


def recorder_of(context, path, *topics):
    return made(Recorder, context, **{"advanced.topics": list(topics), "advanced.output": str(path)})


def messages(path):
    with AnyReader([path]) as bag:
        found = [(one.topic, bag.deserialize(raw, one.msgtype)) for one, _, raw in bag.messages()]
        offered = {one.topic: one.ext.offered_qos_profiles for one in bag.connections}
    return found, {topic: profiles[0] for topic, profiles in offered.items() if profiles}


def test_messages_come_out_as_they_went_in_and_latched_ones_are_told_so(record, tmp_path):
    sender, recorder = record("points", "city_model")
    points = sender.create_publisher(PointCloud2, "points", CLOUD)
    header = sender.create_publisher(String, "city_model", LATCHED)
    features = sender.create_publisher(String, "city_model", BUILDING)
    wait_until(lambda: points.get_subscription_count() and features.get_subscription_count())
    header.publish(String(data='{"type":"CityJSON","version":"2.0"}'))
    sent = to_message(PointTile(np.arange(30.0).reshape(10, 3), stamp=7_000_000_000))
    points.publish(sent)
    for number in range(3):
        features.publish(String(data=f'{{"type":"CityJSONFeature","id":"{number}"}}'))
    wait_until(lambda: recorder.recording.n_messages == 5)
    recorder.destroy_node()
    found, offered = messages(tmp_path / "bag")
    (cloud,) = (one for topic, one in found if topic == "/points")
    assert bytes(cloud.data) == bytes(sent.data)
    assert (cloud.header.stamp.sec, cloud.header.frame_id) == (7, "map")
    lines = [one.data for topic, one in found if topic == "/city_model"]
    assert sorted(lines)[0] == '{"type":"CityJSON","version":"2.0"}'
    assert len(lines) == 4
    assert (offered["/points"].durability.name, offered["/points"].depth) == ("VOLATILE", CLOUD.depth)
    assert (offered["/city_model"].durability.name, offered["/city_model"].history.name) == (
        "TRANSIENT_LOCAL",
        "KEEP_ALL",
    )


def test_a_topic_of_somebody_else_is_recorded_as_soon_as_it_is_there(record, tmp_path):
    sender, recorder = record("/counter")
    counter = sender.create_publisher(Int32, "/counter", CLOUD)
    wait_until(lambda: counter.get_subscription_count())
    counter.publish(Int32(data=42))
    wait_until(lambda: recorder.recording.n_messages)
    recorder.destroy_node()
    ((topic, message),) = messages(tmp_path / "bag")[0]
    assert (topic, message.data) == ("/counter", 42)


@pytest.mark.parametrize("reliability", [ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT])
def test_scans_are_recorded_as_reliably_as_they_are_sent(record, tmp_path, reliability):
    sender, recorder = record("scan")
    scans = sender.create_publisher(PointCloud2, "scan", QoSProfile(depth=5, reliability=reliability))
    wait_until(lambda: len(sender.get_subscriptions_info_by_topic("scan")) == 1)
    (listener,) = sender.get_subscriptions_info_by_topic("scan")
    assert listener.qos_profile.reliability == reliability
    message = to_message(PointTile(np.ones((3, 3))))
    # again and again: what is not sent reliably may get lost
    wait_until(lambda: scans.publish(message) or recorder.recording.n_messages)


def test_what_waits_when_the_recorder_ends_is_still_recorded(context, tmp_path):
    recorder = recorder_of(context, tmp_path / "bag", "roof_faces", "city_model")  # nothing spins it
    recorder._last_heard -= 60.0  # all comes after a long silence
    sender = Node("sender", context=context)
    publisher = sender.create_publisher(String, "city_model", BUILDING)
    wait_until(publisher.get_subscription_count)
    for number in range(50):
        publisher.publish(String(data=str(number)))
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(recorder)
    recorder.interrupted(executor.spin_once)
    executor.shutdown()
    recorder.destroy_node()
    sender.destroy_node()
    assert [one.data for _, one in messages(tmp_path / "bag")[0]] == [str(number) for number in range(50)]


def test_a_full_disk_ends_the_bag_and_says_what_is_missing(record, tmp_path, monkeypatch):
    fill_the_disk(monkeypatch, ".mcap", 3_000_000)
    sender, recorder = record("points")
    points = sender.create_publisher(PointCloud2, "points", CLOUD)
    wait_until(points.get_subscription_count)
    for second in range(4):
        points.publish(to_message(PointTile(np.ones((100_000, 3)), stamp=second * 1_000_000_000)))
    recording = recorder.recording
    wait_until(lambda: recording.n_messages + recording.lost["/points"] == 4 and recorder.summary.problem)
    assert recording.failure.startswith(f"{tmp_path / 'bag'}: can no longer be written (No space left")
    assert recording.lost["/points"] >= 1
    assert recorder.summary.state()[:2] == (2, recording.failure)
    assert not recorder.outcome.done()


def test_what_a_slow_disk_cannot_take_is_left_out_and_counted(tmp_path):
    is_busy, may_go_on, n_written = threading.Event(), threading.Event(), []

    def written(*message):
        n_written.append(message)
        is_busy.set()
        may_go_on.wait()

    recording = Recording(tmp_path / "bag", most_waiting=100)
    recording.declare("/text", "std_msgs/msg/String", offered(0, is_latched=False))
    recording.start(written)
    for number in range(10):
        recording.add("/text", number, serialize_message(String(data=f"number {number:030}")))
        is_busy.wait()
    assert recording.n_waiting <= 100
    may_go_on.set()
    recording.close()
    assert (recording.n_messages, recording.lost["/text"], len(n_written)) == (3, 7, 10)
    assert recording.failure.endswith("bag: the disk is too slow: some messages are dropped")
    assert [one.data[-1] for _, one in messages(tmp_path / "bag")[0]] == ["0", "1", "2"]


def test_what_is_there_is_not_touched(tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "file").write_text("")
    for path, words in (
        (tmp_path / "bag", "already exists"),
        (tmp_path / "file" / "bag", "is not a writable folder"),
    ):
        with pytest.raises(OutputError, match=words):
            Recording(path)
    Recording(tmp_path / "new").close()
    assert not (tmp_path / "new").exists()


def test_a_recorder_without_a_name_for_its_bag_does_not_start(context):
    with pytest.raises(ParameterError, match=r"recorder\.output is empty"):
        Recorder(context=context)
