"""The final result of a feed, whose points are files."""

import json
import shutil

import pytest
from support.results import contents

from lidar_buildings.cli import command_parser
from lidar_buildings.commands.final_result import make_final
from lidar_buildings.commands.run_request import request_of
from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.results.run_folder import PARTIAL, PLACED
from lidar_buildings.io.tiling.live_files import CLOUDS


@pytest.fixture
def live(house, tmp_path):
    """The folder of a feed that has the points of a house."""
    output = tmp_path / "live"
    shutil.copytree(house, output / PARTIAL / PLACED / CLOUDS)
    (output / "of_live_tiles.obj").touch()
    (output / "run.json").write_text(json.dumps({"files": ["of_live_tiles.obj", "run.json"]}))
    return output


def request(output, *words):
    return request_of(command_parser().parse_args(["live", "--output", str(output), *words]))


def test_it_is_that_of_a_run_and_takes_the_place_of_what_was_there(command, house, live, tmp_path):
    mounting = ("--set", "scan_assembler.georeferenced=true")
    outcome = make_final(request(live, *mounting), lambda: False)
    assert command("run", house, "--no-ros", "--output", tmp_path / "run").status == 0
    assert contents(live) == contents(tmp_path / "run")
    told = json.loads((live / "run.json").read_text())
    assert told["files"] == list(outcome.summary.files)
    assert told["feed"] == {"georeferenced": True}
    assert not (live / "of_live_tiles.obj").exists()
    assert [one.name for one in (live / PARTIAL / PLACED).iterdir()] == [CLOUDS]


def test_what_is_there_stays_if_it_is_stopped_or_fails(live):
    def files():
        return sorted(one for one in live.rglob("*") if one.is_file())

    before = files()
    assert make_final(request(live), lambda: True) is None
    assert files() == before
    for one in (live / PARTIAL / PLACED / CLOUDS).iterdir():
        one.unlink()
    with pytest.raises(InputError):
        make_final(request(live), lambda: False)
    assert (live / "of_live_tiles.obj").exists()
