"""Which nodes share their tiles, and the parameters of each."""

import pytest

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.nodes.replication import replicas_of, share_parameters


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
