"""Temporary folders: a process that is killed leaves one until the next is made; a living one's stays."""

import os
import signal
import subprocess
import sys
import tempfile

import pytest

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.io.files.temporary_folder import make_temporary_folder, remove_folder

#: Makes a folder, says which, and waits; if it is told to in a forked process, and ends itself.
HOLDER = """
import os, sys
from lidar_buildings.io.files.temporary_folder import make_temporary_folder
folder = make_temporary_folder()
(folder / "some.points").write_bytes(b"some")
if "fork" not in sys.argv or os.fork() == 0:
    print(folder, flush=True)
    sys.stdin.read()
else:
    os._exit(0)
"""


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    return tmp_path


def holding(*words):
    command = [sys.executable, "-c", HOLDER, *words]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    return process, process.stdout.readline().strip()


def test_what_a_killed_process_left_goes_with_the_next_folder(place):
    process, folder = holding()
    with process:
        own = make_temporary_folder()
        assert {str(one) for one in place.iterdir()} == {folder, str(own)}, "that of a living process stays"
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert os.path.exists(folder)
        another = make_temporary_folder()
    assert set(place.iterdir()) == {own, another}
    remove_folder(own)
    remove_folder(another)
    assert not list(place.iterdir())


def test_a_folder_stays_as_long_as_a_forked_process_lives(place):
    process, folder = holding("fork")
    with process:
        process.wait()
        remove_folder(make_temporary_folder())
        assert os.path.exists(folder)
        process.stdin.close()
        assert not process.stdout.read(), "the end of what the forked process says is that of its life"
    # the kernel closes its files one after the other
    while os.path.exists(folder):
        remove_folder(make_temporary_folder())


def test_what_is_of_others_stays(place):
    (place / "lidar_buildings_0spo72us").mkdir()
    (place / "lidar_buildings_run_link").symlink_to(place / "lidar_buildings_0spo72us")
    (place / "lidar_buildings_run_file").touch()
    before = set(place.iterdir())
    remove_folder(make_temporary_folder())
    assert set(place.iterdir()) == before


def test_without_a_place_it_says_so(place, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(place / "nowhere"))
    with pytest.raises(OutputError, match="temporary files cannot be written"):
        make_temporary_folder()
