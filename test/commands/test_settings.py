"""What a user sets in a file or on the command line, by stage."""

import pytest
from support.bags import write_drive
from support.cloud_files import random_cloud, saved

from bench.pages.node_reference import parameter_yaml
from lidar_buildings.cli import command_parser
from lidar_buildings.commands.run_request import request_of
from lidar_buildings.commands.settings import PRESETS, read_settings
from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.stage_table import STAGE_TABLE


@pytest.fixture
def settings(tmp_path):
    def read(text="", *assignments):
        path = tmp_path / "my.yaml"
        path.write_text(text)
        return read_settings(path, list(assignments))

    return read


def test_parameters_of_a_node_go_to_its_stage_and_the_last_assignment_wins(settings):
    assert settings("roof_selector: {ros__parameters: {min_height: 3.0}}") == {
        "roof_selection": {"min_height": 3.0}
    }
    several = (
        "building_tracer: {ros__parameters: {segmentation: {min_points: 9}, boundary_tracing.window: 4}}"
    )
    assert settings(several) == {"segmentation": {"min_points": 9}, "boundary_tracing": {"window": 4.0}}
    text = "roof_selector: {ros__parameters: {min_height: 3.0, max_part_area: 9.0}}"
    found = settings(text, "roof_selection.min_height=4", "roof_selection.min_height=5")
    assert found == {"roof_selection": {"min_height": 5.0, "max_part_area": 9.0}}


@pytest.mark.parametrize(
    "name", ["roof_selector", "/roof_selector", "/**/roof_selector", "/a/b/roof_selector"]
)
def test_a_node_is_known_in_every_namespace(settings, name):
    assert settings(f"{name}: {{ros__parameters: {{min_height: 3.0}}}}") == {
        "roof_selection": {"min_height": 3.0}
    }


@pytest.mark.parametrize(
    "text", ["roof_selection.min_height=3", "roof_selector.min_height=3.0", " roof_selection.min_height= 3 "]
)
def test_an_assignment_names_the_stage_or_its_node(settings, text):
    assert settings("", text) == {"roof_selection": {"min_height": 3.0}}


@pytest.mark.parametrize("name", ["raster_reach", "advanced.raster_reach"])
def test_advanced_parameters_have_two_spellings(settings, name):
    assert settings("", f"model_writer.{name}=9") == {"model_writer": {"raster_reach": 9.0}}
    text = f"model_writer: {{ros__parameters: {{{name}: 9.0}}}}"
    assert settings(text) == {"model_writer": {"raster_reach": 9.0}}


def test_the_stage_stands_before_an_advanced_name_where_a_node_has_several(settings):
    nested = "building_tracer: {ros__parameters: {footprints: {advanced: {layer: houses}}}}"
    assert settings(nested) == {"footprints": {"layer": "houses"}}
    assert settings("", "building_tracer.footprints.advanced.layer=houses") == settings(nested)


@pytest.mark.parametrize(
    ("name", "nearest"),
    [
        ("raster_reech", "raster_reach"),
        ("advanced.raster_reech", "raster_reach"),
        ("advanced.raster_resolution", "raster_resolution"),
    ],
)
def test_a_wrong_name_suggests_the_nearest(settings, name, nearest):
    with pytest.raises(
        ParameterError, match=rf"no parameter model_writer\.{name} \(did you mean {nearest}\?\)"
    ):
        settings("", f"model_writer.{name}=9")


def test_two_nodes_with_one_stage_must_agree_in_a_file(settings):
    text = (
        "edge_labeller: {{ros__parameters: {{rim_radius: {}}}}}\n"
        "building_tracer: {{ros__parameters: {{edge_labelling.rim_radius: {}}}}}"
    )
    assert settings(text.format(1.5, 1.5)) == {"edge_labelling": {"rim_radius": 1.5}}
    with pytest.raises(ParameterError, match=r"two nodes set edge_labelling\.rim_radius, to 1\.5 and 1\.3"):
        settings(text.format(1.5, 1.3))


@pytest.mark.parametrize(("text", "value"), [("1e1", 10.0), ("1E+1", 10.0), ("1.5e0", 1.5), ("3", 3.0)])
def test_numbers_may_have_an_exponent_as_in_ros(settings, text, value):
    assert settings("", f"roof_selection.min_height={text}") == {"roof_selection": {"min_height": value}}


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
        "building_model.foot": "draped",
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


def test_the_parameter_file_that_we_ship_has_the_defaults(tmp_path):
    (tmp_path / "all.yaml").write_text(parameter_yaml())
    request, plain = asked(tmp_path, "--params", str(tmp_path / "all.yaml")), asked(tmp_path)
    assert request.parameters() == plain.parameters()
