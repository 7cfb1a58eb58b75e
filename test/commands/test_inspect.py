"""What `lidar-buildings inspect` says of clouds, bags, folders, and of what is none of these."""

import json
import sqlite3

import numpy as np
import pytest
from support import cloud_files
from support.bags import SCAN_TYPE, STORAGES, T0, BagWriter, write_drive

from lidar_buildings.commands.inspect import summarise_cloud
from lidar_buildings.io.bags.bag_summary import summarise_bag


def lattice(path, step=0.5, n=60, **changes):
    """A cloud of n × n pulses of one return each."""
    cloud = cloud_files.random_cloud(n * n, point_format=6)
    x, y = np.meshgrid(np.arange(n) * step, np.arange(n) * step)
    cloud.xyz = np.column_stack([x.ravel() + 85000.0, y.ravel() + 447000.0, np.zeros(n * n)])
    cloud.withheld = np.zeros(n * n, np.uint8)
    cloud.return_number, cloud.number_of_returns = np.ones((2, n * n), np.uint8)
    cloud.classification = np.where(np.arange(n * n) < 10, 6, 2).astype(np.uint8)
    cloud.point_source_id = np.arange(n * n) % 3
    cloud.header.global_encoding.gps_time_type = 1
    for name, value in changes.items():
        setattr(cloud, name, value)
    return cloud_files.saved(cloud_files.with_wkt(cloud, "EPSG:28992"), path)


def test_a_cloud_is_summed_up_to_its_last_point(tmp_path):
    found = summarise_cloud(lattice(tmp_path / "a.laz"))
    assert (found.n_points, found.n_pulses, found.crs, found.n_strips) == (3600, 3600, "EPSG:28992", 3)
    assert (found.classes, found.returns) == ({2: 3590, 6: 10}, {1: 3600})
    assert found.density == pytest.approx(4.0, rel=0.1)
    assert found.density_from == "spacing"
    assert found.size == pytest.approx([29.5, 29.5, 0.0])
    assert found.times[0] == "2022-02-27 12:26:22 UTC"
    assert found.format == "LAS 1.4, point format 6, LAZ"


def test_of_few_points_the_density_is_that_of_the_bounds(tmp_path):
    found = summarise_cloud(lattice(tmp_path / "a.las", n=11))
    assert (found.density_from, found.density) == ("bounds", pytest.approx(121 / 25))
    assert found.format.endswith("LAS")


def test_a_cloud_without_a_point_has_its_line(command, tmp_path):
    path = cloud_files.saved(cloud_files.random_cloud(0), tmp_path / "none.laz")
    spoken = command("inspect", path)
    assert spoken.status == 0
    assert spoken.out == [f"{path}: LAS 1.1, point format 1, LAZ, 0 points"]


def test_a_folder_has_a_block_for_each_file(command, tmp_path):
    (tmp_path / "in").mkdir()
    for name in "ab":
        lattice(tmp_path / "in" / f"{name}.laz")
    write_drive(tmp_path / "in" / "drive")
    spoken = command("inspect", tmp_path / "in")
    assert (spoken.status, spoken.err) == (0, [])
    heads = [line for line in spoken.out if not line.startswith("  ")]
    assert [head.split(": ")[0].rsplit("/", 1)[-1] for head in heads] == ["a.laz", "b.laz", "drive"]


def test_what_cannot_be_read_has_a_line_each_and_the_rest_is_listed(command, tmp_path):
    good = lattice(tmp_path / "good.laz")
    cut = cloud_files.shortened(lattice(tmp_path / "cut.laz"), 0.6)
    (tmp_path / "text.mcap").write_text("no bag, but long enough to be taken for one\n" * 10)
    (tmp_path / "empty").mkdir()
    bad = [cut, tmp_path / "text.mcap", tmp_path / "empty", tmp_path / "nowhere"]
    spoken = command("inspect", *bad, good)
    assert spoken.status == 2
    assert [line.split(": ")[1] for line in spoken.err] == [str(path) for path in bad]
    assert spoken.out[0].startswith(f"{good}: ")


def test_json_tells_the_same(command, tmp_path):
    lattice(tmp_path / "a.laz")
    drive = write_drive(tmp_path / "drive")
    spoken = command("inspect", "--json", tmp_path / "a.laz", drive.path)
    cloud, bag = json.loads("\n".join(spoken.out))
    assert (cloud["kind"], cloud["n_points"], cloud["classes"]) == ("cloud", 3600, {"2": 3590, "6": 10})
    assert bag["kind"] == "bag"
    assert bag["taken"]["clouds"] == "/points"
    (points,) = (one for one in bag["topics"] if one["name"] == "/points")
    assert (points["frame"], points["fields"]) == ("lidar", ["x", "y", "z", "intensity", "t"])


@pytest.mark.parametrize("storage", STORAGES)
def test_a_bag_of_every_storage_has_a_line_for_each_topic(command, tmp_path, storage):
    drive = write_drive(tmp_path / "drive", storage, poses="tf", pose_rate=100.0)
    spoken = command("inspect", drive.path)
    assert (spoken.status, spoken.err) == (0, [])
    assert spoken.out[0].startswith(f"{drive.path}: bag of 1.0 s, from 2023-11-14 22:13:20 UTC, ")
    assert spoken.out[1:] == [
        "  /points: sensor_msgs/msg/PointCloud2, 10 messages, 8.91 Hz, frame lidar, "
        f"first cloud of {summarise_bag(drive.path).topics[0].n_points} points (x y z intensity t)",
        "  /tf: tf2_msgs/msg/TFMessage, 102 messages, 100 Hz, frame odom → base",
        "  /tf_static: tf2_msgs/msg/TFMessage, 1 message, frame base → lidar",
        "  a run takes: scans /points, poses /tf, /tf_static",
        "  the scans are placed in frame odom",
        "  no map_origin: the outputs have no reference system",
    ]


def test_where_a_bags_fixes_lie_is_told(tmp_path):
    bag = BagWriter(tmp_path / "fixes")
    bag.write("/points", SCAN_TYPE, T0, bag.cloud(T0, "map", [[1.0, 2.0, 3.0]]))
    types, kind = bag.types.types, "sensor_msgs/msg/NavSatFix"
    for status, latitude in ((-1, 0.0), (0, 52.25), (0, 53.0)):
        state = types["sensor_msgs/msg/NavSatStatus"](status, 1)
        fix = types[kind](bag.header(T0, "gps"), state, latitude, 4.5, 44.0, np.zeros(9), 0)
        bag.write("/fix", kind, T0, fix)
    bag.close()
    notes = summarise_bag(bag.path).notes
    assert notes[-1] == (
        "the map lies in EPSG:32631 by /fix: first at latitude 52.250000, longitude 4.500000, 44.0 m "
        "above the ellipsoid"
    )


def test_clouds_without_any_pose_are_told_of_and_what_helps(tmp_path):
    (bare, _) = summarise_bag(write_drive(tmp_path / "bare", poses="none").path).notes
    assert bare == (
        "no pose leads from the scans' frame 'lidar' to another one: record its odometry or /tf; "
        "or --georeferenced, if the points are already in map coordinates"
    )
    (loose, _) = summarise_bag(write_drive(tmp_path / "drive").path).notes
    assert "or --set scan_assembler.mounting=…, if it is fixed to one of base, odom; or" in loose


@pytest.mark.parametrize("share", [0.001, 0.7])
def test_a_truncated_bag_is_refused_and_what_repairs_it_is_named(command, tmp_path, share):
    drive = write_drive(tmp_path / "drive")
    (file,) = drive.path.glob("*.mcap")
    line = command.refused("inspect", cloud_files.shortened(file, share))
    assert "cannot be read as a bag" in line
    assert "`mcap recover` repairs" in line


def test_a_type_that_nobody_knows_does_not_hide_the_other_topics(tmp_path):
    drive = write_drive(tmp_path / "drive", "sqlite3")
    (file,) = drive.path.glob("*.db3")
    with sqlite3.connect(file) as changed:
        changed.execute("UPDATE topics SET type = 'own_msgs/msg/Secret' WHERE name = '/odometry'")
        changed.execute("DELETE FROM message_definitions")
    topics = {one.name: one for one in summarise_bag(file).topics}
    assert topics["/odometry"].problem.startswith("its type own_msgs/msg/Secret is unknown")
    assert topics["/points"].frame == "lidar"
