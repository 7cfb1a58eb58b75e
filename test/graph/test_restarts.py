"""Nothing is lost when a stage is slow or a node dies."""

import pytest
from support.node_processes import LAST, NodeProcesses
from support.results import assert_complete, contents
from support.slow_stages import label_slowly

from lidar_buildings.cli import main
from lidar_buildings.nodes import edge_labeller
from lidar_buildings.nodes.table import nodes_until

#: Small tiles, so that a small survey has many [m].
TILE_SIZE = 75.0

pytestmark = [pytest.mark.graph, pytest.mark.slow]


def test_a_stage_that_takes_a_second_a_tile_loses_nothing(survey, tmp_path, monkeypatch):
    monkeypatch.setattr(edge_labeller, "label_roof_edges", label_slowly)
    output = tmp_path / "out"
    assert main(["run", str(survey), "--output", str(output), "--tile-size", str(TILE_SIZE)]) == 0
    assert_complete(survey, output, min_tiles=12)


def test_every_node_may_be_killed_and_restarted_in_mid_run(survey, tmp_path):
    expected = tmp_path / "expected"
    assert (
        main(["run", str(survey), "--output", str(expected), "--no-ros", "--tile-size", str(TILE_SIZE)]) == 0
    )
    files = sorted(survey.glob("*.laz"))
    player = {"tile_size": TILE_SIZE, "tile_timeout": 4.0, "max_attempts": 10}
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
    assert contents(tmp_path / "out") == contents(expected)
