"""Runs on workers of dask: the files of a run of one process, and clear words where it cannot be."""

import importlib.util

import pytest

pytest.importorskip("distributed")

from support.cli_runs import files_in
from support.results import contents

from lidar_buildings import cli

pytestmark = pytest.mark.cluster
TILES = ("--tile-size", "20")


@pytest.mark.slow
def test_a_run_on_workers_gives_the_files_of_one_process(command, house, tmp_path):
    alone, shared = tmp_path / "alone", tmp_path / "shared"
    assert cli.main(["run", str(house), "--output", str(alone), "--no-ros", *TILES]) == 0
    left = shared / ".partial" / "points"  # by a run that was killed
    left.mkdir(parents=True)
    (left / "old.points").touch()
    spoken = command("run", house, "--output", shared, "--workers", "2", *TILES)
    assert spoken.status == 0, spoken.err
    assert spoken.err[0].startswith("dashboard: http://127.0.0.1:")
    assert files_in(shared) == files_in(alone)
    assert contents(shared) == contents(alone)


def test_what_says_where_tiles_are_done_is_checked(command, house, tmp_path, monkeypatch):
    output = ("--output", tmp_path / "out")
    assert "must be at least 1" in command("run", house, *output, "--workers", "0").err[-1]
    both = command("run", house, *output, "--workers", "2", "--scheduler", "tcp://localhost:1")
    assert both.status == 2
    assert "not allowed with" in both.err[-1]
    record = command.refused("run", house, *output, "--workers", "2", "--record", tmp_path / "bag")
    assert "remove --no-ros" in record
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert "pip install '.[cluster]' in the sources" in command.refused(
        "run", house, *output, "--workers", "2"
    )
