"""
The same input gives the same files, however the stages are laid out.

"""

from pathlib import Path

import pytest
from node_processes import NodeProcesses
from results import assert_complete, contents

from lidar_buildings.cli import main

TILE_SIZE = 75.0

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
        assert graph.wait_until_written(240) == 0, graph.tails()
    assert contents(output) == contents(without_ros)


def test_two_instances_run_side_by_side_under_different_namespaces(survey, without_ros, tmp_path):
    files = sorted(survey.glob("*.laz"))
    left = NodeProcesses(files, tmp_path / "left", "left", tmp_path, tile_size=TILE_SIZE)
    right = NodeProcesses(files[:1], tmp_path / "right", "right", tmp_path, tile_size=100.0)
    with left, right:
        left.start_all()
        right.start_all()
        assert right.wait_until_written(240) == 0, right.tails()
        assert left.wait_until_written(240) == 0, left.tails()
    assert contents(tmp_path / "left") == contents(without_ros)
    assert {path.name for path in (tmp_path / "right" / "classified").iterdir()} == {files[0].name}
