"""The presets of the three papers: what they set, and what wins over them."""

import pytest
from support.cli_runs import Command

from lidar_buildings.cli import command_parser
from lidar_buildings.commands.run_request import request_of
from lidar_buildings.commands.settings import PRESETS
from lidar_buildings.nodes.reference import parameter_yaml

#: Preset → one thing by which the paper is known, of each stage that it describes.
KNOWN = {
    "santos": {
        "ground_filter.method": "progressive_tin",
        "roof_selection.method": "lasclassify",
        "edge_labelling.features": "linearity",
        "boundary_tracing.source": "edge_points",
    },
    "villalba": {
        "ground_filter.method": "histogram_tin",
        "roof_selection.min_building_area": 40.0,
        "roof_selection.road_method": "grey_values",
        "plane_fitting.method": "ransac",
    },
    "sampath_shan": {
        "ground_filter.method": "slope_pairs",
        "segmentation.min_line_ratio": 1.0,
        "boundary_tracing.neighbourhood": "rectangle",
        "regularisation.division": "slope_changes",
        "regularisation.min_long_wall": 10.0,
    },
}


def asked(tmp_path, *options):
    return request_of(
        command_parser().parse_args(["run", "a.laz", "--output", str(tmp_path / "out"), *options])
    )


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_is_a_word_and_is_told(tmp_path, preset):
    request = asked(tmp_path, "--preset", preset)
    assert request.parameters()["preset"] == preset
    for name, value in KNOWN[preset].items():
        stage, _, member = name.partition(".")
        assert getattr(getattr(request.config, stage), member) == value
    assert "preset" not in asked(tmp_path).parameters()


def test_what_is_set_wins_over_the_preset(tmp_path):
    mine = tmp_path / "mine.yaml"
    mine.write_text("roof_selector: {ros__parameters: {min_height: 1.5, min_building_area: 30.0}}")
    options = ("--preset", "villalba", "--params", str(mine), "--set", "roof_selection.min_height=1.0")
    found = asked(tmp_path, *options).config.roof_selection
    assert (found.min_height, found.min_building_area, found.method) == (1.0, 30.0, "single_returns")


def test_an_unknown_preset_is_refused_by_the_names_of_the_three(capfd, tmp_path):
    line = Command(capfd).refused("run", "a.laz", "--output", tmp_path / "out", "--preset", "shan")
    assert "--preset shan: must be one of santos, villalba, sampath_shan" in line


def test_the_parameter_file_that_we_ship_has_the_defaults(tmp_path):
    (tmp_path / "all.yaml").write_text(parameter_yaml())
    request, plain = asked(tmp_path, "--params", str(tmp_path / "all.yaml")), asked(tmp_path)
    assert request.parameters() == plain.parameters()
