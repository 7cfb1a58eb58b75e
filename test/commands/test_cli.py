"""
The command line's contract: commands, options, exit statuses, files; and runs without ROS from end to end.
"""

import json
import os
import re
import subprocess
import sys

import laspy
import pyogrio
import pytest
from support.cli_runs import CLASSIFIED, FILES, RASTERS, files_in
from support.results import assert_complete, contents

from lidar_buildings import cli
from lidar_buildings.commands import run_local
from lidar_buildings.core.model.stage_table import STAGES
from lidar_buildings.io.models.survey_building import BUILDING_FIELDS
from lidar_buildings.simulation import simulate_survey

ALWAYS = [CLASSIFIED, *RASTERS, "report.html", "run.json"]
#: Tiles of the survey `roofs` [m]: a dozen.
TILE_SIZE = 60.0


@pytest.fixture(scope="module")
def roofs(tmp_path_factory):
    """A survey of fourteen roofs."""
    folder = tmp_path_factory.mktemp("roofs")
    simulate_survey(folder, "roof_types", 0, density=2.0)
    return folder


@pytest.fixture(scope="module")
def result(roofs, tmp_path_factory):
    """What a run over small tiles made of the fourteen roofs."""
    output = tmp_path_factory.mktemp("result") / "out"
    assert (
        cli.main(["run", str(roofs), "--output", str(output), "--no-ros", "--tile-size", str(TILE_SIZE)]) == 0
    )
    return output


def without_times(output):
    """What run.json tells, but for how long it took."""
    told = json.loads((output / "run.json").read_text())
    del told["seconds"]
    return told


def options_of(name):
    """The options and positional arguments of a command."""
    commands = next(action for action in cli.command_parser()._actions if action.choices)
    return {word for one in commands.choices[name]._actions for word in one.option_strings or [one.metavar]}


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        (
            "run",
            {"INPUT", "--output", "--params", "--set", "--until", "--tile-size", "--no-ros", "--overwrite"},
        ),
        ("simulate", {"--output", "--scene", "--seed"}),
        ("score", {"{ground,buildings,outlines,edges,planes,models,control}", "RESULT", "REFERENCE"}),
    ],
)
def test_the_commands_have_the_options_of_the_contract(name, expected):
    assert expected <= options_of(name)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["walk"], "'walk'"),
        (["rnu"], "no 'rnu': did you mean run?"),
        (["run", "a.laz", "--output"], "--output"),
        (["run", "--output", "out"], "INPUT"),
        (["run", "a.laz", "--output", "out", "--tile-siz", "x"], "'x'"),
        (["run", "a.laz", "--output", "out", "--nonsense"], "--nonsense"),
        (["simulate", "--output", "out", "--seed", "many"], "'many'"),
        (["score", "planes", "a", "b"], "a: no such file or folder"),
        (["score", "walls", "a", "b"], "there is no kind 'walls'"),
    ],
)
def test_wrong_use_gives_one_line_and_status_2(command, arguments, words):
    assert words in command.refused(*arguments)


def test_the_command_alone_shows_its_help(command):
    spoken = command()
    assert (spoken.status, spoken.err) == (0, [])
    assert "Raw lidar in, valid 3D city models out." in spoken.out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--scene", "vilage"], "'vilage': must be one of village, single_house, "),
        (["--seed", "-1"], "seed = -1"),
        (["--density", "0"], "density = 0"),
        (["--density", "nan"], "density = nan"),
    ],
)
def test_a_survey_that_cannot_be_simulated_gives_one_line(command, tmp_path, arguments, words):
    assert words in command.refused("simulate", "--output", tmp_path / "out", *arguments)
    assert not (tmp_path / "out").exists()


def test_a_survey_does_not_replace_files_unless_told_to(command, tmp_path, house):
    (tmp_path / "kept.txt").write_text("mine")
    arguments = ["simulate", "--output", tmp_path, "--scene", "single_house", "--density", "1"]
    assert "is not empty" in command.refused(*arguments)
    assert command(*arguments, "--overwrite").status == 0
    assert files_in(tmp_path) == sorted(["kept.txt", *files_in(house)])
    (tmp_path / "file").write_text("")
    assert "file/out: cannot be written" in command.refused("simulate", "--output", tmp_path / "file" / "out")


def test_it_runs_as_a_program_of_its_own(tmp_path, house):
    program = [sys.executable, "-m", "lidar_buildings.cli"]
    done = subprocess.run(
        [*program, "run", house, "--output", tmp_path / "out", "--no-ros"], capture_output=True, text=True
    )
    assert done.returncode == 0
    assert re.fullmatch(r"1 of 1 tile done, 1 building, \d+\.\d\d M points/s\n", done.stderr)
    assert files_in(tmp_path / "out") == FILES
    refused = subprocess.run([*program, "run", "gone", "--output", "x"], capture_output=True, text=True)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr == "lidar-buildings: gone: no such file or folder: check the path\n"
    assert subprocess.run([*program, "--version"], capture_output=True).returncode == 0


@pytest.mark.parametrize(
    ("ending", "status"), [("return 3", 3), ("sys.exit(2)", 2), ("raise OSError", 1), ("return 0", 0)]
)
def test_a_process_with_ros_ends_with_its_status_all_it_said_and_what_is_due_at_the_end(ending, status):
    code = f"""
import atexit, os, sys
from lidar_buildings import cli

def main():
    sys.modules["rclpy"] = os
    atexit.register(print, "late")
    print("said " * 50_000)
    {ending}

cli.main = main
cli.console()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == f"{'said ' * 50_000}\nlate\n"
    assert done.returncode == status
    assert ("OSError" in done.stderr) == (status == 1)


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_stops_listening_is_no_error(house, unbuffered):
    code = f"{sys.executable} -m lidar_buildings.cli score outlines {house} {house} | true"
    shell, environment = (
        ["bash", "-o", "pipefail", "-c", code],
        {**os.environ, "PYTHONUNBUFFERED": unbuffered},
    )
    done = subprocess.run(shell, capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_run_gives_every_file_of_the_contract(roofs, result):
    assert files_in(result) == FILES
    assert_complete(roofs, result, min_tiles=10)
    names = set(laspy.open(result / ALWAYS[0]).header.point_format.dimension_names)
    assert {"HeightAboveGround", "Facade", "BuildingId", "PlaneId", "EdgeLabel"} <= names
    layers = dict(pyogrio.list_layers(result / "buildings.gpkg"))
    assert set(layers) == {
        "outlines", "traced", "roof_faces", "roof_lines", "roof_corners", "layer_styles",
    }  # fmt: skip
    assert layers["roof_faces"].endswith("Z")
    assert set(BUILDING_FIELDS) <= set(
        pyogrio.read_info(result / "buildings.gpkg", layer="outlines")["fields"]
    )


def test_run_json_tells_what_was_done(roofs, result):
    told = json.loads((result / "run.json").read_text())
    cloud = roofs / "strip_01.laz"
    count = laspy.open(cloud).header.point_count
    assert told["inputs"] == [{"path": str(cloud), "point_count": count, "output": ALWAYS[0]}]
    assert sorted(told["files"]) == FILES
    assert told["n_points"] == count == sum(told["classes"].values())
    assert sum(told["buildings"].values()) == 14
    assert (told["problems"], told["failed_tiles"], told["n_unclassified"]) == ([], [], 0)
    assert told["until"] == "building_model"
    assert {"lidar_buildings", "python", "numpy", "laspy"} <= set(told["versions"])
    assert set(told["seconds"]) == {"wall", *STAGES}
    assert told["parameters"]["tile_player"]["tile_size"] == TILE_SIZE
    assert set(STAGES) <= set(told["parameters"])


def test_progress_is_told_in_plain_lines_where_there_is_no_terminal(command, house, tmp_path):
    small = ["--tile-size", "25", "--set", "tile_player.buffer=10"]
    spoken = command("run", house, "--output", tmp_path / "out", "--no-ros", *small)
    told = json.loads((tmp_path / "out" / "run.json").read_text())
    n_tiles, n_points = told["n_tiles"], told["n_points"]
    assert n_tiles >= 9
    assert (spoken.status, spoken.err) == (0, [])
    told_of = [line.split(", ")[0] for line in spoken.progress]
    assert told_of == [f"{n + 1} of {n_tiles} tiles done" for n in range(n_tiles)]
    assert spoken.out[0].startswith(f"{n_points:,} points in {n_tiles} tiles, ")
    assert spoken.out[1] == f"buildings: 1 (1 {next(iter(told['quality']))})"
    reasons = [f"quality_reasons: 1 {cause}" for cause in told["quality_reasons"]]
    assert [line.strip() for line in spoken.out[2:]] == [
        *reasons,
        *(remark["text"] for remark in told["remarks"]),
        *(f"{tmp_path / 'out' / name}" for name in told["files"]),
        f"open first: {tmp_path / 'out' / 'report.html'}",
    ]


def test_a_quiet_run_says_nothing(command, house, tmp_path):
    quick = ["--no-ros", "--until", "ground_filter"]
    spoken = command("run", house, "--output", tmp_path / "out", "--quiet", *quick)
    assert (spoken.status, spoken.out, spoken.err, spoken.progress) == (0, [], [], [])
    assert files_in(tmp_path / "out") == ALWAYS


def test_the_outcome_of_a_run_can_be_read_by_scripts(command, house, tmp_path):
    missing = tmp_path / "nowhere.laz"
    spoken = command("run", house, missing, "--output", tmp_path / "out", "--no-ros", "--json")
    told = json.loads("\n".join(spoken.out))
    assert (spoken.status, spoken.progress, len(spoken.err)) == (2, [], 1)
    assert told["buildings"] == {"ok": 1}
    assert sorted(told["files"]) == FILES
    assert told["output"] == str(tmp_path / "out")
    assert str(missing) in told["problems"][0]


def test_an_error_shows_where_it_comes_from_if_asked(command, tmp_path):
    spoken = command("report", tmp_path, "--debug")
    assert spoken.status == 2
    assert spoken.err[0] == "Traceback (most recent call last):"
    assert spoken.err[-1] == command.refused("report", tmp_path)


@pytest.mark.parametrize("stage", ["ground_filter", "boundary_tracing", "plane_fitting"])
def test_a_run_until_a_stage_or_its_node_writes_just_its_files(command, house, tmp_path, stage):
    until = stage.replace("fitting", "fitter")
    spoken = command("run", house, "--output", tmp_path / "out", "--no-ros", "--until", until)
    assert (spoken.status, spoken.err) == (0, [])
    assert files_in(tmp_path / "out") == [FILES[0], *ALWAYS][stage == "ground_filter" :]
    told = json.loads((tmp_path / "out" / "run.json").read_text())
    assert told["until"] == stage
    assert set(told["seconds"]) == {"wall", *STAGES[: STAGES.index(stage) + 1]}


def test_an_interrupted_run_goes_on_from_its_finished_tiles(command, roofs, result, tmp_path, monkeypatch):
    arguments = ["run", roofs, "--output", tmp_path / "out", "--no-ros", "--tile-size", TILE_SIZE]
    do_tile, seen = run_local.do_tile, []

    def interrupted(work, *others):
        seen.append(work.tile.stamp)
        if len(seen) == 4:
            raise KeyboardInterrupt
        return do_tile(work, *others)

    monkeypatch.setattr(run_local, "do_tile", interrupted)
    spoken = command(*arguments)
    assert spoken.status == 130
    assert spoken.err == ["lidar-buildings: interrupted; run the same command to resume"]
    assert not {*FILES} & {*files_in(tmp_path / "out")}
    assert command(*arguments).status == 0
    assert not set(seen[:3]) & set(seen[4:]), "finished tiles are not done again"
    assert contents(tmp_path / "out") == contents(result)
    assert without_times(tmp_path / "out") == without_times(result)


def test_parameters_come_from_the_file_and_before_it_from_the_command_line(command, house, tmp_path):
    text = "/**/roof_selector: {ros__parameters: {min_height: 2.5, max_part_area: 10.0}}\n"
    (tmp_path / "few.yaml").write_text(text + "plane_fitter: {ros__parameters: {min_plane_area: 7.0}}\n")
    assignments = ["--set", "roof_selection.min_height=3", "--set", "tile_player.buffer=40"]
    given = ["--params", tmp_path / "few.yaml", *assignments, "--until", "roof_selection", "--no-ros"]
    assert command("run", house, "--output", tmp_path / "out", *given).status == 0
    told = json.loads((tmp_path / "out" / "run.json").read_text())["parameters"]
    assert told["roof_selection"]["min_height"] == 3.0
    assert told["roof_selection"]["max_part_area"] == 10.0
    assert told["plane_fitting"]["min_plane_area"] == 7.0
    assert told["tile_player"]["buffer"] == 40.0
