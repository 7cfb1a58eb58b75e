"""Compiled loops are kept where they can be, and are never stale."""

import os

import pytest

from lidar_buildings.core import kernel_cache


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package with one loop, in a home without anything, and where temporary files go."""
    loops = tmp_path / "package" / "core"
    loops.mkdir(parents=True)
    (loops / "a.py").write_text("@njit\n")
    (loops / "plain.py").write_text("\n")
    monkeypatch.setattr(kernel_cache, "_PACKAGE", tmp_path / "package")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(kernel_cache.tempfile, "tempdir", str(tmp_path))
    kernel_cache._state.cache_clear()
    yield tmp_path
    kernel_cache._state.cache_clear()


def refuse(monkeypatch, *folders):
    """Let folders be such that nothing can be written there."""
    allowed = kernel_cache._is_writable
    monkeypatch.setattr(
        kernel_cache,
        "_is_writable",
        lambda one: not any(one.is_relative_to(folder) for folder in folders) and allowed(one),
    )


def test_loops_are_kept_in_the_installation(package):
    assert kernel_cache._choose_folder().parent == package / "package" / "__pycache__"


def test_a_changed_loop_gets_a_folder_of_its_own_and_other_files_do_not_count(package):
    before = kernel_cache._choose_folder()
    (package / "package" / "core" / "plain.py").write_text("x = 1\n")
    kernel_cache._state.cache_clear()
    assert kernel_cache._choose_folder() == before
    (package / "package" / "core" / "a.py").write_text("@njit \n")
    kernel_cache._state.cache_clear()
    assert kernel_cache._choose_folder() != before


def test_another_version_of_numba_gets_a_folder_of_its_own(package, monkeypatch):
    before = kernel_cache._choose_folder()
    monkeypatch.setattr(kernel_cache.metadata, "version", lambda name: "0.58.1")
    kernel_cache._state.cache_clear()
    assert kernel_cache._choose_folder() != before


def test_the_home_serves_an_installation_that_cannot_be_written_and_takes_over_what_it_brings(
    package, monkeypatch
):
    installed = kernel_cache._choose_folder()
    (installed / "loops").mkdir()
    (installed / "loops" / "a.nbc").write_text("code")
    (installed / "x.complete").touch()
    refuse(monkeypatch, package / "package")
    folder = kernel_cache._choose_folder()
    assert folder == package / "home" / "lidar_buildings" / installed.name
    assert (folder / "loops" / "a.nbc").read_text() == "code"
    assert (folder / "x.complete").exists()


def test_a_temporary_folder_serves_where_the_home_cannot_be_written_either(package, monkeypatch):
    refuse(monkeypatch, package / "package", package / "home")
    assert kernel_cache._choose_folder().parent == package


def test_the_folders_of_long_ago_go(package, monkeypatch):
    folder = kernel_cache._choose_folder()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(folder))
    for age in range(4):
        other = folder.with_name(f"kernels-{age}")
        other.mkdir()
        os.utime(other, (1e9 - age, 1e9 - age))
    kernel_cache.remove_earlier_folders()
    assert sorted(one.name for one in folder.parent.iterdir()) == sorted(
        ["kernels-0", "kernels-1", folder.name]
    )


def test_a_user_s_own_folder_is_kept(monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/somewhere")
    kernel_cache.use_kernel_folder()
    assert os.environ["NUMBA_CACHE_DIR"] == "/somewhere"
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    assert kernel_cache.is_compiled()


def test_another_package_in_the_current_folder_is_neither_compiled_nor_executed(tmp_path, monkeypatch):
    decoy = tmp_path / "lidar_buildings"
    decoy.mkdir()
    for name in ("__init__.py", "cli.py"):
        (decoy / name).write_text("open('executed', 'w')\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(kernel_cache, "is_compiled", lambda: False)
    assert kernel_cache.start_compiling().wait() == 0
    assert sorted(one.name for one in tmp_path.rglob("*")) == ["__init__.py", "cli.py", "lidar_buildings"]
