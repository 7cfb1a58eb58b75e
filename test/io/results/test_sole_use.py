"""An output folder is one run's at a time, and free again whatever ends that run."""

import subprocess
import sys

import pytest

from lidar_buildings.cli import main
from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.io.results.run_folder import LOCK, PARTIAL, sole_use

HOLD = """
import sys
from pathlib import Path
from lidar_buildings.io.results.run_folder import sole_use
with sole_use(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.readline()
"""


@pytest.fixture
def other(tmp_path):
    """Another process that has the folder."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path / "out")], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout.readline() == b"held\n"
        yield process
        process.kill()


def test_a_second_run_is_refused_in_one_line_and_touches_nothing(other, tmp_path, capsys):
    tile = tmp_path / "out" / PARTIAL / "1.npz"
    tile.touch()
    for more in ([], ["--overwrite"]):
        assert main(["run", "survey.laz", "--output", str(tmp_path / "out"), *more]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.endswith("/out: another run writes into it: wait for its end, or choose another folder")
    assert tile.exists()


def test_a_folder_is_free_when_the_run_that_had_it_is_killed(other, tmp_path):
    with pytest.raises(OutputError, match="another run writes into it"), sole_use(tmp_path / "out"):
        pass
    other.kill()
    other.wait()
    with sole_use(tmp_path / "out"):
        assert (tmp_path / "out" / PARTIAL / LOCK).exists()


def test_nothing_is_left_of_a_run_that_wrote_nothing(tmp_path):
    (tmp_path / "there").mkdir()
    for name in ("there", "new"):
        with sole_use(tmp_path / name), sole_use(tmp_path / name):
            pass
    assert [path.name for path in tmp_path.rglob("*")] == ["there"]
