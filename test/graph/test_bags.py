"""Bags as inputs of the graph: read by its player as by a run, and played to its assembler."""

import re
import time

import laspy
import numpy as np
import pytest
from support.bags import MOUNTING, write_drive
from support.cli_runs import Command
from support.node_bench import running

from lidar_buildings.nodes.graph import survey_nodes

pytestmark = pytest.mark.graph

MOUNTED = ",".join(map(str, MOUNTING))
UNTIL = ("--until", "ground_filter")


@pytest.fixture
def command(capfd):
    return Command(capfd, "--set", f"scan_assembler.mounting={MOUNTED}", *UNTIL)


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    return write_drive(tmp_path_factory.mktemp("bag") / "drive")


def test_the_nodes_take_bags_as_a_run_does(command, drive, context, tmp_path):
    part = ("--start", "0.35", "--duration", "0.3")
    assert command("run", drive.path, "--no-ros", *part, "--output", tmp_path / "run").status == 0
    settings = {"scan_assembler": {"mounting": MOUNTED}, "tile_player": {"start": 0.35, "duration": 0.3}}
    nodes = survey_nodes(
        (str(drive.path),), str(tmp_path / "graph"), until=UNTIL[1], settings=settings, context=context
    )
    with running(*nodes.values()) as composition:
        assert composition.wait(nodes["model_writer"], 300.0)
    clouds = [laspy.read(tmp_path / one / "classified" / "drive.laz") for one in ("run", "graph")]
    assert 0 < len(clouds[0]) < len(drive.points)
    assert np.array_equal(clouds[0].points.array, clouds[1].points.array)
    assert not (tmp_path / "graph" / ".partial").exists()


def test_a_bag_is_played_as_it_was_recorded(command, drive, tmp_path):
    started = time.monotonic()
    every = ("--set", "scan_assembler.street_voxel=0")
    spoken = command("live", "--replay", drive.path, "--rate", "0.5", *every, "--output", tmp_path / "out")
    assert time.monotonic() - started > 2.0  # of one second
    told = re.findall("lidar-buildings: 10 scans, 5,000 points.* written", "\n".join(spoken.err))
    assert (spoken.status, len(told)) == (0, 1), spoken.err[-3:]
    (cloud,) = (tmp_path / "out" / "classified").iterdir()
    xyz = laspy.read(cloud).xyz
    assert np.abs(xyz - drive.points).max() < 0.02


def test_a_part_in_which_no_scan_lies_is_not_played(command, drive, tmp_path):
    spoken = command("live", "--replay", drive.path, "--start", "99", "--output", tmp_path / "out")
    assert spoken.status == 2
    assert "no scans within start and duration" in spoken.err[-1]


def test_what_is_said_of_a_bag_that_is_not_played_is_refused(command, tmp_path):
    assert "add --replay BAG" in command.refused("live", "--start", "3", "--output", tmp_path / "out")
    missing = command.refused("live", "--replay", tmp_path / "none.mcap", "--output", tmp_path / "out")
    assert "none.mcap" in missing
    assert not (tmp_path / "out").exists()
