"""Versions of libraries that do not do are reported in one line."""

from importlib import metadata

import pytest

from lidar_buildings import cli
from lidar_buildings.commands import versions


@pytest.mark.parametrize(
    ("installed", "does"),
    [
        ("0.58.0", False),
        ("0.9.9", False),
        ("", False),
        ("0.58.1", True),
        ("0.58.1.post1", True),
        ("1.0rc1", True),
    ],
)
def test_an_old_or_missing_library_is_named_in_one_line(installed, does, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(metadata, "requires", lambda name: ["numba>=0.58.1", 'dask>=9; extra == "cluster"'])
    monkeypatch.setattr(versions, "_installed", {"numba": installed, "dask": ""}.get)
    assert cli.main(["report", str(tmp_path / "nothing")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    has = f"{installed or 'none'} is installed"
    assert (line == f"lidar-buildings: numba>=0.58.1 is needed, {has}") is not does


def test_a_library_that_refuses_another_is_reported_in_one_line(monkeypatch, capsys):
    def refuse(options):
        raise ImportError("Numba needs NumPy 2.3 or less. Got NumPy 2.4.")

    monkeypatch.setattr("lidar_buildings.commands.view.report_command", refuse)
    assert cli.main(["report", "somewhere"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "Numba needs NumPy 2.3 or less" in line
