"""Which machine has which nodes of a graph, which share their tiles, and the parameters of each."""

import pytest

from lidar_buildings.commands.placement import nodes_of, replicas_of, share_parameters
from lidar_buildings.core.model.errors import InputError, ParameterError

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


def test_nodes_and_numbers_are_read():
    assert replicas_of("") == {}
    assert replicas_of("roof_selector:2, model_builder:3") == {"roof_selector": 2, "model_builder": 3}


@pytest.mark.parametrize(
    "text", ["tile_player:2", "roof:2", "roof_selector", "roof_selector:0", "roof_selector:x"]
)
def test_what_cannot_be_shared_is_named(text):
    with pytest.raises(ParameterError, match=f"replicas: {text}: "):
        replicas_of(text)


def test_a_replica_has_the_parameters_of_its_kind(tmp_path):
    file = tmp_path / "params.yaml"
    file.write_text(
        "/**/roof_selector:\n  ros__parameters:\n    min_height: 2.0\n"
        "roof_selector:\n  ros__parameters:\n    advanced: {x: 1}\n/**:\n  ros__parameters: {y: 2}\n"
    )
    found = share_parameters(1, 2, [file], "roof_selector")
    assert found == {"min_height": 2.0, "advanced.x": 1, "replica": 1, "replicas": 2}
    assert share_parameters(0, 2, [""], "roof_selector") == {"replica": 0, "replicas": 2}
