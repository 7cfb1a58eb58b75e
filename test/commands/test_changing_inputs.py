"""Files that are replaced while they are used, and files that are there twice: said, and nothing mixed."""

import json
import shutil

import laspy
import pytest
from support.cli_runs import SMALL_TILES, Command, files_in
from support.results import contents

from lidar_buildings.commands import run_local


@pytest.fixture
def command(capfd):
    return Command(capfd, "--no-ros", *SMALL_TILES)


@pytest.fixture(scope="module")
def house(house):
    """The cloud of the house."""
    return house / "strip_01.laz"


@pytest.fixture
def pair(house, tmp_path):
    """The house, and another one a kilometre east."""
    folder = tmp_path / "pair"
    folder.mkdir()
    shutil.copy(house, folder / "a.laz")
    other = laspy.read(house)
    other.x = other.x + 1000.0
    other.write(folder / "b.laz")
    return folder


def replaced(path):
    """Let a file look written to."""
    path.write_bytes(path.read_bytes() + b"\0")


def said_of(path):
    return f"lidar-buildings: {path}: changed during the run: run it again with --overwrite"


def test_a_file_that_is_replaced_before_it_is_read_is_left_out(command, house, pair, tmp_path, monkeypatch):
    alone, out = tmp_path / "alone", tmp_path / "out"
    assert command("run", pair / "a.laz", "--output", alone).status == 0
    original = run_local.OutputFolder

    def folder(*arguments, **keywords):
        replaced(pair / "b.laz")
        return original(*arguments, **keywords)

    with monkeypatch.context() as patched:
        patched.setattr(run_local, "OutputFolder", folder)
        spoken = command("run", pair, "--output", out)
    assert spoken.status == 2
    assert spoken.err == [said_of(pair / "b.laz")]
    assert (out / "classified" / "a.laz").read_bytes() == (alone / "classified" / "a.laz").read_bytes()
    assert not (out / "classified" / "b.laz").exists()
    told = [json.loads((folder / "run.json").read_text()) for folder in (out, alone)]
    assert told[0]["buildings"] == told[1]["buildings"]
    assert command("run", pair, "--output", out, "--overwrite").status == 0


def test_a_file_that_is_replaced_after_it_was_read_gets_no_classes_of_other_points(
    command, pair, tmp_path, monkeypatch
):
    original = run_local._Tiles.finish

    def finish(tiles, *n_left):
        original(tiles, *n_left)
        if not n_left:
            replaced(pair / "b.laz")

    monkeypatch.setattr(run_local._Tiles, "finish", finish)
    spoken = command("run", pair, "--output", tmp_path / "out")
    assert spoken.status == 2
    assert spoken.err == [said_of(pair / "b.laz")]
    assert [name for name in files_in(tmp_path / "out") if name.startswith("classified")] == [
        "classified/a.laz"
    ]


@pytest.mark.parametrize("moment", ["before it is read", "after it was read"])
def test_a_run_goes_on_where_it_was_when_a_file_that_was_deleted_is_there_again(
    command, pair, tmp_path, monkeypatch, moment
):
    whole, out, away = tmp_path / "whole", tmp_path / "out", tmp_path / "away.laz"
    assert command("run", pair, "--output", whole).status == 0
    original, finish = run_local.OutputFolder, run_local._Tiles.finish

    def folder(*arguments, **keywords):
        (pair / "b.laz").rename(away)
        return original(*arguments, **keywords)

    def finished(tiles, *n_left):
        finish(tiles, *n_left)
        if not n_left:
            (pair / "b.laz").rename(away)

    with monkeypatch.context() as patched:
        if moment == "before it is read":
            patched.setattr(run_local, "OutputFolder", folder)
        else:
            patched.setattr(run_local._Tiles, "finish", finished)
        spoken = command("run", pair, "--output", out)
    assert spoken.status == 2
    assert any("the run is not finished: repeat the command when" in line for line in spoken.out)
    assert "b.laz was one of them" in command.refused("run", pair, "--output", out)
    away.rename(pair / "b.laz")
    spoken = command("run", pair, "--output", out)
    assert spoken.status == 0
    n_tiles = json.loads((whole / "run.json").read_text())["n_tiles"]
    n_again = int(spoken.progress[-1].split()[2])
    assert 0 < n_again < n_tiles, "the tiles of the other file are not done again"
    assert contents(out) == contents(whole)
    assert "contains a finished run" in command.refused("run", pair, "--output", out)


def test_points_that_are_there_twice_count_once(command, house, tmp_path, caplog):
    alone, out = tmp_path / "alone", tmp_path / "out"
    assert command("run", house, "--output", alone).status == 0
    copy, unpacked = tmp_path / "copy.laz", tmp_path / "unpacked.las"
    shutil.copy(house, copy)
    laspy.read(house).write(unpacked)
    spoken = command("run", house, copy, unpacked, "--output", out)
    assert spoken.status == 0
    assert caplog.messages == [f"{copy} and 1 more with the same points as other inputs: left out"]
    assert contents(out) == contents(alone)
