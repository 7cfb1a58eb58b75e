"""What a user sets in a file or on the command line, by stage."""

import pytest

from lidar_buildings.commands.settings import read_settings
from lidar_buildings.core.model.errors import ParameterError


@pytest.fixture
def settings(tmp_path):
    def read(text="", *assignments):
        path = tmp_path / "my.yaml"
        path.write_text(text)
        return read_settings(path, list(assignments))

    return read


def test_nothing_set_is_nothing(settings):
    assert settings() == read_settings(None, []) == {}


def test_parameters_of_a_node_go_to_its_stage(settings):
    assert settings("roof_selector: {ros__parameters: {min_height: 3.0}}") == {
        "roof_selection": {"min_height": 3.0}
    }
    several = (
        "building_tracer: {ros__parameters: {segmentation: {min_points: 9}, boundary_tracing.window: 4}}"
    )
    assert settings(several) == {"segmentation": {"min_points": 9}, "boundary_tracing": {"window": 4.0}}


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


def test_the_last_assignment_wins_over_earlier_ones_and_over_the_file(settings):
    text = "roof_selector: {ros__parameters: {min_height: 3.0, max_part_area: 9.0}}"
    found = settings(text, "roof_selection.min_height=4", "roof_selection.min_height=5")
    assert found == {"roof_selection": {"min_height": 5.0, "max_part_area": 9.0}}


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


def test_lists_of_texts_are_read_and_an_empty_text_alone_is_an_empty_list(settings):
    assert settings("tile_player: {ros__parameters: {input: [a, b]}}") == {
        "tile_player": {"input": ("a", "b")}
    }
    assert settings("tile_player: {ros__parameters: {input: ['']}}") == {"tile_player": {"input": ()}}
