"""The heavy nodes on another host: two network namespaces that share no memory."""

import subprocess
from pathlib import Path

import pytest
from support.results import contents
from support.two_hosts import HOSTS, OnTwoHosts, two_hosts

from lidar_buildings.cli import main

pytestmark = [pytest.mark.graph, pytest.mark.slow]
#: Cuts the survey into sixteen tiles [m].
TILE_SIZE = 100.0


@pytest.fixture
def hosts(monkeypatch):
    monkeypatch.setenv("ROS_STATIC_PEERS", ";".join(HOSTS.values()))
    try:
        with two_hosts() as made:
            yield made
    except (OSError, subprocess.CalledProcessError) as error:
        why = getattr(error, "stderr", None) or error
        pytest.skip(f"network namespaces are not permitted here: {why}")


def test_heavy_nodes_on_another_host_give_the_same_files(hosts, survey: Path, tmp_path: Path):
    given = {"tile_size": TILE_SIZE}
    with OnTwoHosts(hosts, sorted(survey.glob("*.laz")), tmp_path / "out", "far", tmp_path, **given) as graph:
        graph.start_all()
        assert graph.wait_until_written(400) == 0, graph.tails()
    here = tmp_path / "here"
    assert main(["run", str(survey), "--output", str(here), "--no-ros", "--tile-size", str(TILE_SIZE)]) == 0
    assert contents(tmp_path / "out") == contents(here)
