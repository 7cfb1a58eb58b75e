"""The same input gives the same files, however the stages are laid out."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from support.node_processes import NodeProcesses
from support.results import assert_buildings_once, assert_complete, contents

from lidar_buildings.cli import main

#: Cuts the survey into sixteen tiles [m].
TILE_SIZE = 100.0

pytestmark = [pytest.mark.graph, pytest.mark.slow]


@pytest.fixture(scope="module")
def without_ros(survey: Path, tmp_path_factory) -> Path:
    output = tmp_path_factory.mktemp("layout") / "without_ros"
    assert main(["run", str(survey), "--output", str(output), "--no-ros", "--tile-size", str(TILE_SIZE)]) == 0
    return output


def test_without_ros_every_point_is_classified_and_every_building_is_there_once(survey, without_ros):
    assert_complete(survey, without_ros, min_tiles=12)


def test_one_process_gives_the_same_files(survey, without_ros, tmp_path):
    output = tmp_path / "one_process"
    assert main(["run", str(survey), "--output", str(output), "--tile-size", str(TILE_SIZE)]) == 0
    assert contents(output) == contents(without_ros)


def test_a_process_per_node_gives_the_same_files(survey, without_ros, tmp_path):
    output = tmp_path / "processes"
    files = sorted(survey.glob("*.laz"))
    with NodeProcesses(files, output, "apart", tmp_path, tile_size=TILE_SIZE) as graph:
        graph.start_all()
        assert graph.wait_until_written(400) == 0, graph.tails()
    assert contents(output) == contents(without_ros)


def test_nodes_that_share_the_tiles_give_the_same_files(survey, without_ros, tmp_path):
    output = tmp_path / "replicas"
    files = sorted(survey.glob("*.laz"))
    replicas = {"roof_selector": 2, "building_tracer": 2, "model_builder": 2}
    given = {"tile_size": TILE_SIZE, "max_tiles_in_flight": 4}
    with NodeProcesses(files, output, "shared", tmp_path, replicas=replicas, **given) as graph:
        graph.start_all()
        assert graph.wait_until_written(400) == 0, graph.tails()
    assert contents(output) == contents(without_ros)
    told = json.loads((output / "run.json").read_text())
    assert told["seconds"].keys() >= {"roof_selection", "building_model"}
    assert "replicas" not in told["parameters"]


def test_two_instances_run_side_by_side_under_different_namespaces(survey, without_ros, tmp_path):
    command = [sys.executable, "-m", "lidar_buildings.cli", "run"]
    options = {
        "left": [str(survey), "--tile-size", str(TILE_SIZE)],
        "right": [str(sorted(survey.glob("*.laz"))[0]), "--tile-size", "150"],
    }
    both = [
        subprocess.Popen([*command, *given, "--output", str(tmp_path / name), "--namespace", name])
        for name, given in options.items()
    ]
    assert [run.wait(400) for run in both] == [0, 0]
    assert contents(tmp_path / "left") == contents(without_ros)
    assert len(list((tmp_path / "right" / "classified").iterdir())) == 1
    assert_buildings_once(tmp_path / "right")
