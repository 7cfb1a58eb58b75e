"""Output folders that cannot be used, full disks, tiles that fail: one line, and nothing half-made."""

import importlib.util
import json
import shutil

import pyogrio
import pytest
from support import cli_runs, cloud_files
from support.cli_runs import CLASSIFIED, FILES, RASTERS, TILES3D, Command, files_in
from support.results import MODELS, assert_rest_is_complete, contents

from lidar_buildings.cli import main
from lidar_buildings.pipeline import reconstruct as pipeline

SMALL_TILES = ["--no-ros", *cli_runs.SMALL_TILES]
QUICK = ["--until", "ground_filter"]


@pytest.fixture
def command(capfd):
    return Command(capfd, *SMALL_TILES)


@pytest.fixture(scope="module")
def result(house, tmp_path_factory):
    """What an undisturbed run gives."""
    folder = tmp_path_factory.mktemp("result") / "out"
    assert main(["run", str(house), "--output", str(folder), *SMALL_TILES]) == 0
    assert json.loads((folder / "run.json").read_text())["n_tiles"] >= 9
    return folder


def test_an_output_folder_that_cannot_be_made_gives_one_line(command, house, tmp_path):
    (tmp_path / "file").write_text("mine")
    for path in (tmp_path / "file" / "out", tmp_path / "file", "/proc/out", "/dev/null/out"):
        line = command.refused("run", house, "--output", path)
        assert line.startswith(f"lidar-buildings: {path}: cannot be used for output (")
        assert "choose another folder" in line
    assert (tmp_path / "file").read_text() == "mine"


def test_a_folder_that_holds_something_is_not_written_into_unless_told_to(command, house, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "kept.txt").write_text("mine")
    assert "--overwrite" in command.refused("run", house, "--output", out)
    assert files_in(out) == ["kept.txt"]
    assert command("run", house, "--output", out, "--overwrite", *QUICK).status == 0
    assert files_in(out) == sorted([CLASSIFIED, *RASTERS, "kept.txt", "report.html", "run.json"])
    assert (out / "kept.txt").read_text() == "mine"


def test_a_finished_run_is_replaced_only_on_request(command, house, result, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(result, out)
    line = command.refused("run", house, "--output", out)
    assert "contains a finished run: give --overwrite" in line
    assert contents(out) == contents(result)
    spoken = command("run", house, "--output", out, "--overwrite", *QUICK)
    assert spoken.status == 0
    left = [CLASSIFIED, *RASTERS, "report.html", "run.json"]
    assert files_in(out) == left, "nothing of the earlier run is left"


def test_an_unfinished_run_of_other_parameters_is_not_mixed_in(command, house, tmp_path, monkeypatch):
    out = tmp_path / "out"
    with monkeypatch.context() as full:
        cloud_files.fill_the_disk(full, "run.part", 0)
        assert command("run", house, "--output", out, *QUICK).status == 2
    other = ["run", house, "--output", out, *QUICK, "--set", "roof_selection.min_height=2.5"]
    assert "unfinished run with other inputs or parameters" in command.refused(*other)
    assert command(*other, "--overwrite").status == 0
    assert json.loads((out / "run.json").read_text())["parameters"]["roof_selection"]["min_height"] == 2.5


#: Part of the name of the file that finds the disk full → the files that cannot be there by then.
FULL = {
    "identity": FILES,
    "npz": FILES,
    "strip_01.part": [CLASSIFIED, "run.json"],
    "features": [*MODELS, "run.json"],
    "city_model.part.dxf": ["city_model.dxf", "run.json"],
    "run.part": ["run.json"],
}


@pytest.mark.parametrize("name", FULL)
def test_a_full_disk_gives_one_line_and_the_run_goes_on_when_there_is_room(
    command, house, result, tmp_path, monkeypatch, name
):
    out = tmp_path / "out"
    with monkeypatch.context() as full:
        cloud_files.fill_the_disk(full, name, 50)
        spoken = command("run", house, "--output", out)
    assert spoken.status == 2
    assert len(spoken.err) == 1
    assert spoken.err[0].startswith(f"lidar-buildings: {out}")
    assert "No space left on device" in spoken.err[0]
    assert ("repeat the command" in spoken.err[0]) == (name != "identity")  # nothing is done then
    final = [path for path in files_in(out) if not path.startswith(".partial/")]
    assert not set(final) & set(FULL[name])
    same = [path for path in final if path not in (TILES3D, "report.html")]  # it tells seconds
    assert all((out / path).read_bytes() == (result / path).read_bytes() for path in same), "none is a part"
    assert not [path for path in files_in(out) if ".part." in path]
    again = command("run", house, "--output", out)
    assert again.status == 0
    assert [name for name in files_in(out) if not name.startswith(".partial")] == FILES
    assert contents(out) == contents(result)


def test_a_full_disk_in_the_temporary_folder_says_which_folder(command, house, tmp_path, monkeypatch):
    cloud_files.fill_the_disk(monkeypatch, ".points", 1000)
    line = command.refused("run", house, "--output", tmp_path / "out")
    assert (
        "temporary files cannot be written (No space left on device): free some space, or set TMPDIR" in line
    )


def test_a_full_disk_in_the_geopackage_leaves_no_part_of_it(command, house, result, tmp_path, monkeypatch):
    out = tmp_path / "out"

    def full(*_, **__):
        raise pyogrio.errors.DataSourceError("database or disk is full")

    with monkeypatch.context() as patched:
        patched.setattr(pyogrio.raw, "write", full)
        spoken = command("run", house, "--output", out)
    assert spoken.status == 2
    assert len(spoken.err) == 1
    assert f"{out / 'buildings.gpkg'}: cannot be written" in spoken.err[0]
    final = [path for path in files_in(out) if not path.startswith(".partial/")]
    assert final == [CLASSIFIED, *RASTERS]
    assert command("run", house, "--output", out).status == 0
    assert contents(out) == contents(result)


def test_a_tile_that_fails_gives_status_3_and_the_rest_is_complete(
    command, house, result, tmp_path, monkeypatch
):
    original, called = pipeline.regularise_outlines, []

    def fail_once(*arguments):
        called.append(1)
        if len(called) == 3:
            raise ZeroDivisionError("made to\nfail")
        return original(*arguments)

    out = tmp_path / "out"
    with monkeypatch.context() as patched:
        patched.setattr(pipeline, "regularise_outlines", fail_once)
        spoken = command("run", house, "--output", out)
    assert spoken.status == 3
    whole, told = (json.loads((folder / "run.json").read_text()) for folder in (result, out))
    (failed,) = told["failed_tiles"]
    reason = "ZeroDivisionError: made to fail"
    assert failed["reason"] == reason
    assert spoken.err == [
        f"lidar-buildings: tile {failed['tile']} failed ({reason}): the rest is complete",
        f"lidar-buildings: {told['n_unclassified']:,} points kept their previous class: "
        "repeat the command with --retry-failed",
    ]
    assert told["n_tiles"] == whole["n_tiles"] - 1
    assert spoken.progress[-1].startswith(f"{told['n_tiles']} of ")
    assert [name for name in files_in(out) if not name.startswith(".partial")] == FILES
    assert_rest_is_complete(house, out, result, told["n_unclassified"])


def test_without_ros_on_the_machine_it_says_what_to_install_or_to_add(capfd, house, tmp_path, monkeypatch):
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "rclpy" else find_spec(name)
    )
    line = Command(capfd).refused("run", house, "--output", tmp_path / "out")
    assert line.startswith("lidar-buildings: rclpy is not installed: ")
    assert "[ros]" in line
    assert "--no-ros" in line
    assert not (tmp_path / "out").exists()
