"""The same input gives the same files, however the stages are laid out, and whichever of them dies."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from support.node_processes import LAST, NodeProcesses
from support.results import assert_buildings_once, assert_complete, contents
from support.ros_domain import OF_PROFILES
from support.two_hosts import HOSTS, OnTwoHosts, two_hosts

from lidar_buildings.cli import main
from lidar_buildings.nodes.table import nodes_until

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


def test_nodes_that_share_the_tiles_beside_another_graph_give_the_same_files(survey, without_ros, tmp_path):
    output, other = tmp_path / "replicas", tmp_path / "other"
    files = sorted(survey.glob("*.laz"))
    command = [sys.executable, "-m", "lidar_buildings.cli", "run", files[0], "--output", other]
    beside = subprocess.Popen([*command, "--tile-size", "150", "--namespace", "other"])
    replicas = {"roof_selector": 2, "building_tracer": 2, "model_builder": 2}
    given = {"tile_size": TILE_SIZE, "max_tiles_in_flight": 4}
    with NodeProcesses(files, output, "shared", tmp_path, replicas=replicas, **given) as graph:
        graph.start_all()
        assert graph.wait_until_written(400) == 0, graph.tails()
    assert contents(output) == contents(without_ros)
    told = json.loads((output / "run.json").read_text())
    assert told["seconds"].keys() >= {"roof_selection", "building_model"}
    assert "replicas" not in told["parameters"]
    assert beside.wait(400) == 0
    assert len(list((other / "classified").iterdir())) == 1
    assert_buildings_once(other)


@pytest.fixture
def hosts(monkeypatch):
    for name in OF_PROFILES:  # tests before may have set them for this host alone
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_STATIC_PEERS", ";".join(HOSTS.values()))
    try:
        with two_hosts() as made:
            yield made
    except (OSError, subprocess.CalledProcessError) as error:
        why = getattr(error, "stderr", None) or error
        pytest.skip(f"network namespaces are not permitted here: {why}")


def test_heavy_nodes_on_another_host_give_the_same_files(hosts, survey, without_ros, tmp_path):
    output, files = tmp_path / "out", sorted(survey.glob("*.laz"))
    with OnTwoHosts(hosts, files, output, "far", tmp_path, tile_size=TILE_SIZE) as graph:
        graph.start_all()
        assert graph.wait_until_written(400) == 0, graph.tails()
    assert contents(output) == contents(without_ros)


def test_every_node_may_be_killed_and_restarted_in_mid_run(survey, without_ros, tmp_path):
    files = sorted(survey.glob("*.laz"))
    player = {"tile_size": TILE_SIZE, "tile_timeout": 1.0, "max_attempts": 10}
    with NodeProcesses(files, tmp_path / "out", "killed", tmp_path, **player) as graph:
        # slowed, so that the run is still on when the last node is killed
        slow = {"ground_filter": ("filter_ground", 0.5)}
        graph.start_all(slow)
        for number, name in enumerate(nodes_until(LAST), start=1):
            # the time of a tile doubles with each attempt: one that lost several nodes waits for minutes
            graph.wait_for_tiles(number, 450)
            assert not (graph.output / "run.json").exists(), f"the run was over before {name} was killed"
            graph.kill(name)
            graph.start(name, slow.get(name))
        assert graph.wait_until_written(400) == 0, graph.tails()
    assert contents(tmp_path / "out") == contents(without_ros)
