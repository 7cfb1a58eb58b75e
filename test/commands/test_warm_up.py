"""The loops are compiled once, by whoever comes first, and all of them."""

import gc
import os
import threading
import time

import pytest
from numba import njit

from lidar_buildings.cli import main
from lidar_buildings.commands import stage_calls, warm_up
from lidar_buildings.core import kernel_cache
from lidar_buildings.simulation import simulate_survey


def compiled():
    """The loops of the package that are compiled or loaded, each with the types that it was called with."""
    kind = type(njit(lambda: 0))
    loops = [one for one in gc.get_objects() if isinstance(one, kind)]
    return {
        (one.py_func.__module__, one.py_func.__name__, types)
        for one in loops
        for types in one.signatures
        if one.py_func.__module__.startswith("lidar_buildings.")
    }


def test_a_run_needs_no_loop_that_warming_up_does_not_compile(tmp_path):
    simulate_survey(tmp_path / "survey", "single_house", density=4.0)
    for call in stage_calls.CALLS:
        call()
    before = compiled()
    assert main(["run", str(tmp_path / "survey"), "--output", str(tmp_path / "result"), "--no-ros"]) == 0
    assert compiled() - before == set()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "not" / "yet" / "there"))
    return tmp_path / "not" / "yet" / "there"


def test_a_wrong_path_or_folder_is_told_of_before_anything_is_compiled(folder, tmp_path, capsys):
    (tmp_path / "used").mkdir()
    (tmp_path / "used" / "notes.txt").touch()
    for given, output, words in (
        ("nowhere.laz", "result", "nowhere.laz: no such file"),
        (tmp_path, "result", "contains no"),
        (tmp_path / "used", "used", "contains no"),
    ):
        assert main(["run", str(given), "--output", str(tmp_path / output)]) == 2
        assert words in capsys.readouterr().err
    (tmp_path / "a.laz").touch()
    assert main(["run", str(tmp_path / "a.laz"), "--output", str(tmp_path / "used")]) == 2
    assert "is not empty" in capsys.readouterr().err
    assert not list(folder.rglob("*.nb?"))


def test_warming_up_says_how_far_it_is_and_where_the_loops_are(folder, monkeypatch, capsys):
    monkeypatch.setattr(stage_calls, "CALLS", (os.getpid, os.getppid))
    assert main(["warm-up"]) == 0
    printed = capsys.readouterr()
    assert printed.err.splitlines() == [f"{kernel_cache.TEXT}: {done} of 2" for done in range(3)]
    assert str(folder) in printed.out
    assert main(["warm-up", "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert kernel_cache.start_compiling() is None


def test_of_processes_that_start_together_one_compiles(folder, monkeypatch):
    calls = []

    def slowly():
        calls.append(threading.current_thread())
        time.sleep(0.2)

    monkeypatch.setattr(warm_up, "_call_all", slowly)
    together = [threading.Thread(target=warm_up.compile_loops) for _ in range(4)]
    for one in together:
        one.start()
    for one in together:
        one.join()
    assert len(calls) == 1


def test_a_stage_that_fails_leaves_the_loops_uncompiled(folder, monkeypatch):
    monkeypatch.setattr(stage_calls, "CALLS", (os.wait,))
    with pytest.raises(ChildProcessError):
        warm_up.compile_loops()
    assert not kernel_cache.is_compiled()
