"""Every bad input and every wrong parameter: one line, the right exit status, and the rest complete."""

import json
import logging

import laspy
import numpy as np
import pytest
from support import cloud_files
from support.cli_runs import BAD, RASTERS, TILES3D, Command, bad_clouds, files_in
from support.results import MODELS

FILES = ["buildings.gpkg", *MODELS, *RASTERS, "report.html", "run.json", TILES3D]
WITHOUT_POINTS = ["buildings.gpkg", *MODELS, "report.html", "run.json"]


@pytest.fixture
def command(capfd):
    return Command(capfd, "--no-ros")


@pytest.fixture(scope="module")
def house(house):
    """The cloud of the house."""
    return house / "strip_01.laz"


@pytest.fixture
def bad(tmp_path, house):
    return bad_clouds(tmp_path / "bad", house)


@pytest.mark.parametrize("case", BAD)
def test_a_bad_input_alone_gives_one_line_and_no_result(command, bad, tmp_path, case):
    path, words = bad[case]
    line = command.refused("run", path, "--output", tmp_path / "out")
    assert line.startswith(f"lidar-buildings: {path}: ")
    assert words in line
    assert not (tmp_path / "out").exists() or files_in(tmp_path / "out") == [".partial/identity.json"]


def test_bad_inputs_among_good_ones_give_a_line_each_and_the_rest_is_complete(command, bad, house, tmp_path):
    spoken = command("run", *(path for path, _ in bad.values()), house, "--output", tmp_path / "out")
    assert spoken.status == 2
    said = {line.split(": ")[1]: line for line in spoken.err}
    assert len(said) == len(spoken.err) == len(bad)
    assert all(words in said[str(path)] for path, words in bad.values())
    assert files_in(tmp_path / "out") == sorted([*FILES, "classified/strip_01.laz"])
    told = json.loads((tmp_path / "out" / "run.json").read_text())
    assert sorted(told["problems"]) == sorted(one.removeprefix("lidar-buildings: ") for one in spoken.err)
    assert sum(told["buildings"].values()) == 1
    assert (laspy.read(tmp_path / "out" / "classified" / "strip_01.laz").classification > 0).all()


@pytest.mark.parametrize(
    ("n_points", "same", "ending"),
    [(0, False, "las"), (0, False, "laz"), (1, False, "laz"), (300, True, "laz")],
)
def test_clouds_without_extent_are_legal_and_come_out_as_they_were(
    command, tmp_path, caplog, n_points, same, ending
):
    cloud = cloud_files.random_cloud(n_points, point_format=6)
    cloud.withheld = np.zeros(n_points, dtype=np.uint8)  # points that the file calls noise have no raster
    if same:
        cloud.xyz = np.tile([85010.0, 447010.0, 3.0], (n_points, 1))
    path = cloud_files.saved(cloud, tmp_path / f"tiny.{ending}")
    with caplog.at_level(logging.WARNING):
        spoken = command("run", path, "--output", tmp_path / "out")
    assert spoken.status == 0
    # what the logger says goes to stderr where pytest does not hold it
    lines = [*spoken.err, *caplog.messages]
    assert len(lines) == 1
    said = f"no building was found: of {n_points} points " if n_points else f"{path}: contains no points"
    assert said in lines[0]
    assert (" points 0 are roof" in lines[0]) == (n_points > 0)
    files = FILES[:-1] if n_points else WITHOUT_POINTS  # no reference system, no 3D Tiles
    assert files_in(tmp_path / "out") == sorted([*files, "classified/tiny.laz"])
    after = laspy.read(tmp_path / "out" / "classified" / "tiny.laz")
    assert np.array_equal(after.X, cloud.X)
    assert np.array_equal(after.gps_time, cloud.gps_time)


SET = {
    "unknown stage": ("ground_filte.method=x", "no stage 'ground_filte' (did you mean ground_filter?)"),
    "unknown name": ("roof_selection.min_hight=2", "roof_selection.min_hight (did you mean min_height?)"),
    "below its range": ("roof_selection.min_height=-1", "roof_selection.min_height = -1.0: must be within"),
    "no number": ("roof_selection.min_height=.nan", "roof_selection.min_height = nan: must be within"),
    "text for a number": ("roof_selection.min_height=high", "= 'high': must be of type float"),
    "no value": ("roof_selection.min_height=", "= None: must be of type float"),
    "unknown word": ("ground_filter.method=magic", "= 'magic': must be one of consensus"),
    "no stage": ("min_height=2", "must be STAGE.NAME=VALUE, as in roof_selection.min_height=2.5"),
    "no YAML": ("roof_selection.min_height={", "is not a value"),
    "node with several stages": ("model_builder.min_height=2", "must begin with one of building_model., "),
    "another node's output": ("model_writer.output=there", "is set by --output"),
    "no credit": ("tile_player.max_tiles_in_flight=0", "max_tiles_in_flight = 0: "),
}


@pytest.mark.parametrize("case", SET)
def test_a_wrong_assignment_gives_one_line_before_anything_is_read(command, house, tmp_path, case):
    text, words = SET[case]
    assert words in command.refused("run", house, "--output", tmp_path / "out", "--set", text)
    assert not (tmp_path / "out").exists()


PARAMS = {
    "malformed YAML": ("ground_filter: [1,\n  b: }\n", "not valid YAML (line 2, column 6: "),
    "no mapping": ("- a\n- b\n", "no node names at its top"),
    "unknown node": (
        "ground_filte: {ros__parameters: {}}",
        "no node 'ground_filte' (did you mean ground_filter?)",
    ),
    "no ros__parameters": ("ground_filter: {method: x}", "ground_filter has no ros__parameters"),
    "wrong type": (
        "roof_selector: {ros__parameters: {min_height: often}}",
        "= 'often': must be of type float",
    ),
    "stage left out": (
        "model_builder: {ros__parameters: {min_height: 2.0}}",
        "model_builder.min_height: the name must begin with one of building_model., ",
    ),
}


@pytest.mark.parametrize("case", PARAMS)
def test_a_wrong_parameter_file_gives_one_line_naming_it(command, house, tmp_path, case):
    text, words = PARAMS[case]
    path = tmp_path / "my.yaml"
    path.write_text(text)
    line = command.refused("run", house, "--output", tmp_path / "out", "--params", path)
    assert line.startswith(f"lidar-buildings: {path}: ")
    assert words in line
    assert not (tmp_path / "out").exists()


def test_a_parameter_file_that_cannot_be_read_is_named(command, house, tmp_path):
    arguments = ["run", house, "--output", tmp_path / "out", "--params"]
    assert "gone.yaml: No such file" in command.refused(*arguments, tmp_path / "gone.yaml")
    assert f"{tmp_path}: Is a directory" in command.refused(*arguments, tmp_path)
    assert f"{house}: not valid YAML" in command.refused(*arguments, house)


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--until", "edges", "--until edges: must be one of ground_filter, "),
        ("--until", "model_writer", "must be one of"),
        ("--tile-size", "1", "tile_size = 1.0: must be 0 or within 10 to 10000 [m]"),
        ("--tile-size", "-1", "tile_size = -1.0: must be within 0 to 10000 [m]"),
        ("--tile-size", "inf", "tile_size = inf: must be within"),
        ("--namespace", "1st floor", "--namespace '1st floor': must be names"),
    ],
)
def test_a_wrong_option_gives_one_line_before_anything_is_read(
    command, house, tmp_path, option, value, words
):
    assert words in command.refused("run", house, "--output", tmp_path / "out", option, value)
    assert not (tmp_path / "out").exists()
