"""The command line through the node graph: what a user can cause gives the same lines, statuses and files."""

import json
import os
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest
from support import cloud_files
from support.cli_runs import FILES, PROGRESS, RASTERS, SMALL_TILES, Command, bad_clouds, files_in
from support.results import MODELS, assert_rest_is_complete, contents
from support.waiting import wait_until

from lidar_buildings.cli import main
from lidar_buildings.core.model.stage_table import STAGES
from lidar_buildings.nodes import stage_nodes

pytestmark = pytest.mark.graph


@pytest.fixture
def command(capfd):
    return Command(capfd, *SMALL_TILES)


@pytest.fixture(scope="module")
def result(house, tmp_path_factory):
    """What an undisturbed run without ROS gives."""
    folder = tmp_path_factory.mktemp("result") / "out"
    assert main(["run", str(house), "--output", str(folder), "--no-ros", *SMALL_TILES]) == 0
    return folder


def test_the_graph_says_and_writes_what_the_run_without_ros_does(command, house, result, tmp_path):
    spoken = command("run", house, "--output", tmp_path / "out", "--namespace", "/site/north_1")
    assert (spoken.status, spoken.err) == (0, [])
    told = json.loads((result / "run.json").read_text())
    n_tiles = told["n_tiles"]
    assert spoken.progress[-1].startswith(f"{n_tiles} of {n_tiles} tiles done, 1 building, ")
    assert spoken.out[1] == f"buildings: 1 (1 {next(iter(told['quality']))})"
    assert files_in(tmp_path / "out") == FILES
    assert contents(tmp_path / "out") == contents(result)
    mine, theirs = (json.loads((folder / "run.json").read_text()) for folder in (tmp_path / "out", result))
    seconds = mine.pop("seconds"), theirs.pop("seconds")
    parameters = mine.pop("parameters"), theirs.pop("parameters")
    assert mine == theirs
    assert set(seconds[0]) == set(seconds[1]) == {"wall", *STAGES}
    # a node may have parameters beside those of its stage: what it publishes, where it writes
    for name in (*STAGES, "model_writer"):
        assert parameters[1][name].items() <= parameters[0][name].items()
    assert parameters[0]["tile_player"].items() >= parameters[1]["tile_player"].items()


def test_a_run_until_a_stage_gives_the_same_files_as_without_ros(command, house, tmp_path):
    arguments = ["run", house, "--until", "plane_fitting", "--output"]
    assert command(*arguments, tmp_path / "graph").status == 0
    assert command(*arguments, tmp_path / "plain", "--no-ros").status == 0
    assert files_in(tmp_path / "graph") == files_in(tmp_path / "plain")
    for name in set(files_in(tmp_path / "plain")) - {"run.json", "report.html"}:
        assert (tmp_path / "graph" / name).read_bytes() == (tmp_path / "plain" / name).read_bytes()


def test_bad_inputs_among_good_ones_give_a_line_each_and_the_rest_is_complete(
    command, house, result, tmp_path
):
    bad = bad_clouds(tmp_path / "bad", house / "strip_01.laz")
    bad.pop("damage in the middle")
    spoken = command("run", house, *(path for path, _ in bad.values()), "--output", tmp_path / "out")
    assert spoken.status == 2
    assert len(spoken.err) == len(bad)
    for path, words in bad.values():
        (line,) = [line for line in spoken.err if line.startswith(f"lidar-buildings: {path}: ")]
        assert words in line
    assert files_in(tmp_path / "out") == FILES
    assert contents(tmp_path / "out") == contents(result)


def test_a_file_that_turns_out_damaged_while_it_is_read_gives_one_line(command, house, tmp_path):
    damaged, words = bad_clouds(tmp_path / "bad", house / "strip_01.laz")["damage in the middle"]
    spoken = command("run", house, damaged, "--output", tmp_path / "out")
    assert spoken.status == 2
    assert len(spoken.err) == 1
    assert spoken.err[0].startswith(f"lidar-buildings: {damaged}: ")
    assert words in spoken.err[0]
    assert files_in(tmp_path / "out") == FILES
    assert words in command.refused("run", damaged, "--output", tmp_path / "alone")


@pytest.mark.parametrize("n_points", [0, 1])
def test_no_point_and_one_point_are_legal(command, tmp_path, n_points):
    cloud = cloud_files.random_cloud(n_points, point_format=6)
    cloud.withheld = np.zeros(n_points, dtype=np.uint8)  # points that the file calls noise have no raster
    path = cloud_files.saved(cloud, tmp_path / "tiny.laz")
    spoken = command("run", path, "--output", tmp_path / "out")
    assert spoken.status == 0
    assert spoken.out[1] == "buildings: 0"
    rasters = RASTERS if n_points else []
    assert files_in(tmp_path / "out") == [
        "buildings.gpkg",
        *MODELS,
        "classified/tiny.laz",
        *rasters,
        "report.html",
        "run.json",
    ]


def test_an_output_folder_that_cannot_be_used_gives_one_line(command, house, result, tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "kept.txt").write_text("mine")
    shutil.copytree(result, tmp_path / "done")
    for path, words in (
        ("file/out", "cannot be used for output"),
        ("full", "is not empty: give --overwrite"),
        ("done", "contains a finished run: give --overwrite"),
    ):
        line = command.refused("run", house, "--output", tmp_path / path)
        assert line.startswith(f"lidar-buildings: {tmp_path / path}: ")
        assert words in line
    assert command("run", house, "--output", tmp_path / "full", "--overwrite").status == 0
    assert contents(tmp_path / "full") == contents(result)
    assert (tmp_path / "full" / "kept.txt").read_text() == "mine"


@pytest.mark.parametrize("name", ["npz", "strip_01.part"])
def test_a_full_disk_gives_one_line_and_the_run_goes_on_when_there_is_room(
    command, house, result, tmp_path, monkeypatch, name
):
    out = tmp_path / "out"
    with monkeypatch.context() as full:
        full.setattr(
            "lidar_buildings.pipeline.building_pool.n_cores", lambda: 1
        )  # processes have other disks
        cloud_files.fill_the_disk(full, name, 50)
        spoken = command("run", house, "--output", out)
    assert spoken.status == 2
    assert len(spoken.err) == 1
    assert spoken.err[0].startswith(f"lidar-buildings: {out}")
    assert "No space left on device" in spoken.err[0]
    assert not [path for path in files_in(out) if ".part." in path]
    assert command("run", house, "--output", out).status == 0
    assert contents(out) == contents(result)


def test_a_full_disk_in_the_temporary_folder_gives_one_line(command, house, tmp_path, monkeypatch):
    cloud_files.fill_the_disk(monkeypatch, ".points", 1000)
    line = command.refused("run", house, "--output", tmp_path / "out")
    assert "temporary files cannot be written (No space left on device)" in line


@pytest.mark.parametrize(
    ("node", "function"), [("ground_filter", "filter_ground"), ("outline_regulariser", "regularise_outlines")]
)
def test_a_tile_that_fails_each_time_gives_status_3_and_the_rest_is_complete(
    command, house, result, tmp_path, monkeypatch, node, function
):
    original, chosen = getattr(stage_nodes, function), []

    def fail_on_one_tile(*arguments, **named):
        # outlines carry no stamp, but only one tile has any
        stamp = getattr(arguments[0], "stamp", None)
        if len(arguments[0]) and chosen in ([], [stamp]):
            chosen[:] = [stamp]
            raise ZeroDivisionError("made to\nfail")
        return original(*arguments, **named)

    out = tmp_path / "out"
    with monkeypatch.context() as patched:
        # nodes do their work in this process where there is one core
        patched.setattr("lidar_buildings.pipeline.building_pool.n_cores", lambda: 1)
        patched.setattr(stage_nodes, function, fail_on_one_tile)
        spoken = command("run", house, "--output", out)
    assert spoken.status == 3
    told = json.loads((out / "run.json").read_text())
    (failed,) = told["failed_tiles"]
    reason = f"{node}: ZeroDivisionError: made to fail"
    assert failed["reason"] == reason
    assert spoken.err[0] == f"lidar-buildings: tile {failed['tile']} failed ({reason}): the rest is complete"
    assert " points kept their previous class: " in spoken.err[1]
    assert len(spoken.err) == 2
    assert [one for one in files_in(out) if not one.startswith(".partial")] == FILES
    assert told["is_finished"] is False
    assert_rest_is_complete(house, out, result, told["n_unclassified"])


def test_an_interrupted_run_goes_on_from_its_finished_tiles(command, house, result, tmp_path):
    out, temporary = tmp_path / "out", tmp_path / "temporary"
    temporary.mkdir()
    program = [sys.executable, "-m", "lidar_buildings.cli", "run", house, "--output", out, *SMALL_TILES]
    running = subprocess.Popen(
        [*program, "--set", "tile_player.rate=1e-9"],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(temporary)},
    )
    wait_until(lambda: list(out.glob(".partial/*.npz")) or running.poll() is not None)
    assert list(temporary.iterdir())
    running.send_signal(signal.SIGTERM)  # it ends a command as Ctrl-C does
    assert running.wait(240) == 130
    assert not list(temporary.iterdir())
    said = running.stderr.read().splitlines()
    assert said[-1] == "lidar-buildings: interrupted; run the same command to resume"
    assert all(PROGRESS.fullmatch(line) for line in said[:-1])
    assert not {*FILES} & {*files_in(out)}
    done = {path.name: path.stat().st_mtime_ns for path in out.glob(".partial/*.npz")}
    assert done
    finished = command("run", house, "--output", out)
    assert (finished.status, finished.err) == (0, [])
    assert contents(out) == contents(result)


def test_a_feed_of_which_nothing_could_be_placed_ends_when_it_is_interrupted(tmp_path):
    out = tmp_path / "out"
    program = [
        sys.executable,
        "-m",
        "lidar_buildings.cli",
        "live",
        "--output",
        str(out),
        "--namespace",
        "still",
    ]
    running = subprocess.Popen(
        program,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert any("listening" in line for line in running.stderr)
    running.send_signal(signal.SIGINT)
    said = running.communicate(timeout=120)[1]
    assert running.returncode == 2
    assert said.splitlines()[-1].endswith(
        "no scan has arrived on /still/scan; nothing to write: no point was placed"
    )
