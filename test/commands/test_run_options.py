"""Options of `run` that stand for parameters."""

import pytest
from support.bags import write_drive
from support.cloud_files import random_cloud, saved

from lidar_buildings.cli import command_parser
from lidar_buildings.commands.run_request import request_of
from lidar_buildings.core.model.stage_table import STAGE_TABLE


def test_georeferenced_takes_the_scans_of_a_bag_as_they_are(command, tmp_path):
    bare = write_drive(tmp_path / "bare", poses="none")
    run = ("run", bare.path, "--no-ros", "--until", "ground_filter", "--output")
    assert "(--georeferenced)" in command.refused(*run, tmp_path / "no")
    spoken = command(*run, tmp_path / "out", "--georeferenced")
    assert spoken.status == 0
    assert "5,000 points of 10 scans placed" in spoken.err[0]


def test_a_rate_is_the_players(tmp_path):
    options = command_parser().parse_args(
        ["run", "a.laz", "--output", str(tmp_path / "out"), "--rate", "2.5"]
    )
    assert request_of(options).settings["tile_player"]["rate"] == 2.5


def test_a_rate_without_the_graph_or_that_is_none_is_refused(command, tmp_path):
    run = ("run", saved(random_cloud(), tmp_path / "a.laz"), "--output", tmp_path / "out")
    line = command.refused(*run, "--rate", "2", "--no-ros")
    assert "--rate: needs ROS" in line
    assert "tile_player.rate = -1.0: must be within 0 to 1e+06" in command.refused(*run, "--rate", "-1")
    assert "must be of type float" in command.refused(*run, "--rate", "nan")


@pytest.mark.parametrize("stage", STAGE_TABLE, ids=lambda stage: stage.node)
def test_a_run_until_a_node_ends_with_the_stage_of_that_node(tmp_path, stage):
    run = ["run", "a.laz", "--output", str(tmp_path), "--until", stage.node]
    assert request_of(command_parser().parse_args(run)).until == stage.name
