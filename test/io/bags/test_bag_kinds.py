"""Bags as they are in the wild are read, or refused by what they are."""

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.typesys import get_types_from_msg
from support.bags import MOUNTED, SCAN_TYPE, SECOND, T0, BagWriter, placed, with_profile, write_drive

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.scans.placing import UNREADABLE
from lidar_buildings.io.bags.bag_summary import summarise_bag
from lidar_buildings.io.bags.scan_types import LIVOX, LIVOX_TEXT


@pytest.mark.parametrize("profile", ["", "x"])
def test_a_file_of_any_profile_is_read_and_a_folder_without_a_storage_identifier(tmp_path, profile):
    drive = write_drive(tmp_path / "drive")
    (file,) = drive.path.glob("*.mcap")
    other = with_profile(file, profile, ["protobuf"]).rename(tmp_path / "other.mcap")
    las, count = placed(tmp_path, other)
    assert (count.n_points, count.warnings) == (5000, [])
    assert np.abs(las.xyz - drive.points).max() < 0.02
    notes = {one.name: one.problem for one in summarise_bag(other).topics}
    assert notes["/protobuf"] == "its messages are encoded protobuf: only messages of ROS are read"
    for storage in ("mcap", "sqlite3"):
        bag = write_drive(tmp_path / storage, storage).path
        meta = bag / "metadata.yaml"
        meta.write_text(meta.read_text().replace(f"storage_identifier: {storage}", 'storage_identifier: ""'))
        assert placed(tmp_path, bag)[1].n_points == 5000


def test_messages_of_ros_1_in_mcap_are_read(tmp_path):
    drive = write_drive(tmp_path / "drive", "ros1", poses="tf")
    from rosbags.rosbag1 import Reader

    with Reader(drive.path) as reader, open(tmp_path / "ros1.mcap", "wb") as out:
        writer, ids = Writer(out), {}
        writer.start("ros1")
        for connection, time, raw in reader.messages():
            if connection.topic not in ids:
                name = connection.msgtype.replace("/msg/", "/")
                schema = writer.register_schema(name, "ros1msg", connection.msgdef.data.encode())
                ids[connection.topic] = writer.register_channel(connection.topic, "ros1", schema)
            writer.add_message(ids[connection.topic], time, raw, time)
        writer.finish()
    las, _ = placed(tmp_path, tmp_path / "ros1.mcap", ScanConfig())
    assert np.abs(las.xyz - drive.points).max() < 0.02


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_message_of_length_zero_is_left_out_and_counted(tmp_path, storage):
    bag = BagWriter(tmp_path / "bag", storage)
    for number in range(5):
        bag.write("/points", SCAN_TYPE, T0 + number, bag.cloud(T0 + number, "map", [[1.0, 2.0, number]]))
    bag.writer.write(bag.connections["/points"], T0 + 9, b"")
    bag.close()
    _, count = placed(tmp_path, bag.path, ScanConfig())
    assert (count.n_points, count.messages) == (5, {UNREADABLE: 1})
    assert "one of the messages that cannot be read: /points: " in count.warnings[0]


def test_only_what_is_cut_off_is_called_so(tmp_path):
    for storage in ("mcap", "sqlite3", "ros1"):
        path = write_drive(tmp_path / storage, storage).path
        file = path if path.is_file() else next(one for one in path.iterdir() if one.suffix != ".yaml")
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
        with pytest.raises(InputError, match=f"{path.name}: cannot be read as a bag .*it is cut off"):
            placed(tmp_path, path)
    for name, content in (
        ("no.bag", b"nothing"),
        ("no.mcap", b"nothing"),
        ("no.db3", b""),
        ("no2.mcap", b""),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=rf"{name}: cannot be read as a bag \(.*it is damaged, or none"):
            placed(tmp_path, tmp_path / name)


@pytest.mark.parametrize("kind", LIVOX)
def test_scans_of_livox_are_read(tmp_path, kind):
    bag = BagWriter(tmp_path / "livox")
    bag.types.register(get_types_from_msg(LIVOX_TEXT.format(package=kind.split("/")[0]), kind))
    point = bag.types.types[kind.replace("CustomMsg", "CustomPoint")]
    header = bag.types.types["std_msgs/msg/Header"]
    stamp = bag.types.types["builtin_interfaces/msg/Time"]
    for number in range(3):
        points = [point(k * 10_000_000, 1.0 + k, 2.0, 3.0, 40 + k, 0, 1) for k in range(10)]
        now = T0 + number * SECOND // 10
        head = header(stamp(now // SECOND, now % SECOND), "map")
        scan = bag.types.types[kind](head, now, 10, 0, np.zeros(3, np.uint8), points)
        bag.write("/livox/lidar", kind, now, scan)
    bag.close()
    las, _ = placed(tmp_path, bag.path, ScanConfig())
    assert las.xyz[:10, 0].tolist() == [1.0 + k for k in range(10)]
    assert las.intensity[:10].tolist() == [40 + k for k in range(10)]
    np.testing.assert_allclose(np.diff(las.gps_time), 0.01, atol=1e-6)


@pytest.mark.parametrize(
    ("kind", "what"),
    [
        ("velodyne_msgs/msg/VelodyneScan", "packets of Velodyne.*velodyne_pointcloud"),
        ("ouster_sensor_msgs/msg/PacketMsg", "packets of Ouster.*ouster_ros"),
        (
            "point_cloud_interfaces/msg/CompressedPointCloud2",
            "compressed clouds, as of draco.*point_cloud_transport",
        ),
        ("foxglove_msgs/msg/PointCloud", "clouds of Foxglove"),
        ("sensor_msgs/msg/LaserScan", "scans in one plane"),
    ],
)
def test_scans_of_other_types_are_named_with_what_makes_clouds_of_them(tmp_path, kind, what):
    bag = BagWriter(tmp_path / "other")
    bag.types.register({} if kind in bag.types.types else get_types_from_msg("int32 number", kind))
    bag.connections["/s"] = bag.writer.add_connection("/s", kind, typestore=bag.types)
    bag.close()
    with pytest.raises(InputError, match=f"contains no sensor_msgs/msg/PointCloud2; /s holds {what}"):
        placed(tmp_path, bag.path)


def test_of_a_part_of_a_bag_nothing_is_lost_at_its_ends(tmp_path):
    from lidar_buildings.io.bags.bag_inputs import BagConfig

    drive = write_drive(tmp_path / "drive", seconds=2.0, pose_rate=4.0)
    _, count = placed(tmp_path, drive.path, MOUNTED, BagConfig(start=0.45, duration=1.0))
    assert count.n_scans == 10
    assert count.left_out == {}
