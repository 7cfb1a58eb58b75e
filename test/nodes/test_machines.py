"""Which machine has which nodes of a graph."""

import pytest

from lidar_buildings.core.model.errors import InputError, ParameterError
from lidar_buildings.nodes.machines import nodes_of

NODES = ("tile_player", "roof_selector_0", "roof_selector_1")


@pytest.fixture
def written(tmp_path):
    def write(text):
        path = tmp_path / "machines.yaml"
        path.write_text(text)
        return path

    return write


def test_each_machine_has_its_nodes(written):
    path = written("disks: [tile_player, roof_selector_0]\nother:\n  - roof_selector_1\nidle: []\n")
    assert nodes_of("disks", path, NODES) == {"tile_player", "roof_selector_0"}
    assert nodes_of("other", path, NODES) == {"roof_selector_1"}
    assert nodes_of("idle", path, NODES) == set()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("disks: [tile_player, roof_selector_0]", "roof_selector_1: must be on one machine, and is on 0"),
        (f"disks: {list(NODES)}\nb: [tile_player]", "tile_player: must be on one machine, and is on 2"),
        ("disks: [tile_player, roof_selector]", "roof_selector: the graph has tile_player, roof_selector_0"),
        (f"b: {list(NODES)}", "machine: disks: .*machines.yaml has b: give machine:=NAME"),
    ],
)
def test_a_map_that_does_not_fit_the_graph_is_refused(written, text, words):
    with pytest.raises(ParameterError, match=words):
        nodes_of("disks", written(text), NODES)


@pytest.mark.parametrize("text", ["disks: tile_player", "[1, 2]", "a: [", ""])
def test_what_is_no_map_is_refused(written, text):
    with pytest.raises(InputError, match="machines"):
        nodes_of("disks", written(text), NODES)


def test_a_map_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        nodes_of("disks", tmp_path / "none.yaml", NODES)
