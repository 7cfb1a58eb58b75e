"""Bags as inputs of a run."""

import json
import shutil

import laspy
import numpy as np
import pyogrio
import pytest
from support.bags import MOUNTING, ORIGIN_TYPE, SCAN_TYPE, SECOND, T0, BagWriter, write_drive

from lidar_buildings.io.bags.bag_inputs import bags_beside_clouds, bags_of, is_bag

ROWS = [(name, "<f4") for name in ("x", "y", "z", "intensity", "scan_angle")] + [("gps_time", "<f8")]
ROWS += [(name, "u1") for name in ("return_number", "number_of_returns", "scan_direction_flag")]
ROWS += [("point_source_id", "<u2")]
MOUNTED = ("--set", f"scan_assembler.mounting={','.join(map(str, MOUNTING))}")


def bag_of(survey, path):
    """The points of a survey as scans in the map frame, and where that lies."""
    (file,) = survey.glob("*.laz")
    las = laspy.read(file)
    origin = np.floor(las.header.mins / 100.0) * 100.0
    bag = BagWriter(path)
    bag.write("/map_origin", ORIGIN_TYPE, T0, bag.origin(las.header.parse_crs().to_string(), *origin))
    rows = np.zeros(len(las.points), ROWS)
    rows["x"], rows["y"], rows["z"] = (las.xyz - origin).T
    rows["scan_angle"] = np.asarray(las.scan_angle) * 0.006
    for name in {name for name, _ in ROWS} - {"x", "y", "z", "scan_angle"}:
        rows[name] = las[name]
    for number, part in enumerate(np.array_split(rows, 20)):
        now = T0 + number * SECOND // 10
        bag.write("/points", SCAN_TYPE, now, bag.cloud_of(now, "map", part))
    bag.close()
    return bag.path


def test_a_bag_gives_the_buildings_that_its_points_give_as_a_file(command, house, tmp_path):
    bag = bag_of(house, tmp_path / "house")
    for source, output in ((house, "file"), (bag, "bag")):
        run = ("run", source, "--no-ros", "--output", tmp_path / output, "--until", "plane_fitting")
        assert command(*run).status == 0
    same = laspy.read(tmp_path / "bag" / "classified" / "house.laz")
    (before,) = (laspy.read(one) for one in (tmp_path / "file" / "classified").iterdir())
    assert np.array_equal(before.xyz, same.xyz)
    for name in ("gps_time", "classification", "HeightAboveGround", "PlaneId", "EdgeLabel"):
        np.testing.assert_array_equal(np.asarray(before[name]), np.asarray(same[name]), err_msg=name)
    mine, theirs = (
        pyogrio.raw.read(tmp_path / one / "buildings.gpkg", layer="outlines")[2].tolist()
        for one in ("bag", "file")
    )
    assert mine == theirs
    assert len(mine) == 1
    told = json.loads((tmp_path / "bag" / "run.json").read_text())
    (record,) = told["parameters"]["bags"]
    assert (record["bag"], record["n_scans"], record["left_out"]) == (str(bag), 20, {})
    assert told["files"][0] == "classified/house.laz"
    assert not (tmp_path / "bag" / ".partial").exists()


def test_what_was_left_out_is_said_and_a_placed_bag_is_not_placed_again(command, tmp_path, monkeypatch):
    drive = write_drive(tmp_path / "drive")
    run = ("run", drive.path, "--no-ros", "--output", tmp_path / "out", *MOUNTED)
    with monkeypatch.context() as failing:
        failing.setattr("lidar_buildings.commands.run._outcome", lambda *_: 1 / 0)
        assert command(*run).status == 1
    monkeypatch.setattr("lidar_buildings.io.bags.placed_cloud.write_placed", lambda *_: 1 / 0)
    assert command(*run, "--until", "ground_filter").status == 0
    assert len(laspy.read(tmp_path / "out" / "classified" / "drive.laz").points) == 5000


def test_bags_of_one_name_are_all_read_and_one_named_twice_once(command, tmp_path):
    drives = []
    for place, n_points in (("north", 5000), ("south", 4000)):  # the same points would be left out
        (tmp_path / place).mkdir()
        drives.append(write_drive(tmp_path / place / "drive", n_points=n_points))
    given = (drives[0].path, drives[1].path, drives[0].path)
    run = ("run", *given, "--no-ros", "--output", tmp_path / "out", *MOUNTED)
    assert command(*run, "--until", "ground_filter").status == 0
    written = sorted((tmp_path / "out" / "classified").iterdir())
    assert [one.name for one in written] == ["drive.laz", "drive_2.laz"]
    assert [len(laspy.read(one).points) for one in written] == [5000, 4000]


def test_bags_beside_clouds_are_left_and_named(command, tmp_path):
    survey = tmp_path / "survey"
    survey.mkdir()
    flight = write_drive(tmp_path / "flight").path
    shutil.copytree(flight, survey / "flight")
    assert bags_of(survey) == [survey / "flight"]
    assert bags_beside_clouds(survey) == []
    (survey / "a.laz").write_bytes(b"")
    assert bags_of(survey) == []
    assert bags_beside_clouds(survey) == [survey / "flight"]
    done = command("run", survey, "--no-ros", "--output", tmp_path / "out")
    assert f"lidar-buildings: {survey}: contains point clouds; ignoring its bags: flight" in done.err


def test_options_of_bags_without_a_bag_are_refused(command, tmp_path):
    (tmp_path / "a.laz").write_bytes(b"")
    line = command.refused("run", tmp_path / "a.laz", "--topic", "/points", "--output", tmp_path / "out")
    assert "--topic: is about bags, but no INPUT is a bag" in line


@pytest.mark.parametrize("option", ["--topic", "--odometry"])
def test_a_second_topic_of_a_kind_is_refused(command, tmp_path, option):
    given = ("run", tmp_path, option, "/front", option, "/rear", "--output", tmp_path / "out")
    assert "/rear: /front was already given" in command.refused(*given)


def test_a_bag_whose_scans_cannot_be_placed_gives_one_line(command, tmp_path):
    drive = write_drive(tmp_path / "drive")
    line = command.refused("run", drive.path, "--no-ros", "--output", tmp_path / "out")
    assert line.startswith(f"lidar-buildings: {drive.path}: no pose leads from the scans' frame 'lidar'")


@pytest.mark.parametrize(
    ("name", "expected"), [("a.MCAP", True), ("a.db3", True), ("a.bag", True), ("a.laz", False)]
)
def test_bags_are_known_by_their_endings_or_their_metadata(tmp_path, name, expected):
    assert is_bag(str(tmp_path / name)) == expected
    folder = tmp_path / "folder"
    folder.mkdir()
    assert not is_bag(str(folder))
    (folder / "metadata.yaml").touch()
    assert is_bag(str(folder))


def test_a_bag_without_metadata_is_read_whole_and_bags_in_a_folder_are_all_read(command, tmp_path):
    (tmp_path / "drives").mkdir()
    run = ("--no-ros", "--until", "ground_filter", *MOUNTED)
    for name, n_points in (("drive", 5000), ("back", 4000)):
        drive = write_drive(tmp_path / name, n_points=n_points)
        (file,) = [one for one in drive.path.iterdir() if one.suffix != ".yaml"]
        (drive.path / "metadata.yaml").unlink()
        if name == "drive":
            assert command("run", drive.path, "--output", tmp_path / "one", *run).status == 0
            assert len(laspy.read(tmp_path / "one" / "classified" / "drive.laz").points) == n_points
        file.rename(tmp_path / "drives" / f"{name}{file.suffix}")
    assert command("run", tmp_path / "drives", "--output", tmp_path / "out", *run).status == 0
    written = sorted((tmp_path / "out" / "classified").iterdir())
    assert [one.name for one in written] == ["back.laz", "drive.laz"]
    assert [len(laspy.read(one).points) for one in written] == [4000, 5000]
