"""An output folder that is there already: which are refused, taken up again, or replaced."""

import subprocess
import sys

import numpy as np
import pytest
from support import cloud_files
from support.cut_surveys import tiles_of
from support.made_results import bytes_of, products_of, run
from support.saved_tiles import load_products

from lidar_buildings.cli import main
from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.io.clouds.find_inputs import InputFile
from lidar_buildings.io.results.output_folder import OutputFolder
from lidar_buildings.io.results.run_folder import LOCK, PARTIAL, sole_use
from lidar_buildings.io.tiling.tiling import TileSource


def test_an_unfinished_run_is_taken_up_again(tmp_path, survey):
    source, tiles = survey
    run(tmp_path / "whole", source, tiles)
    output = OutputFolder(tmp_path / "out", source.inputs, source.frame)
    for tile in tiles[:3]:
        output.write_tile(products_of(tile))
    again = OutputFolder(tmp_path / "out", source.inputs, source.frame)
    assert again.on_disk.keys() == {tile.stamp for tile in tiles[:3]}
    with TileSource([i.path for i in source.inputs], source.config, skip=again.on_disk) as rest:
        for tile in tiles_of(rest):
            again.write_tile(products_of(tile))
    again.finalise({"versions": {"lidar_buildings": "0"}})
    assert bytes_of(tmp_path / "out") == bytes_of(tmp_path / "whole")


@pytest.mark.parametrize("share", [0.0, 0.001, 0.5, 0.99])
@pytest.mark.parametrize("name", ["{}.npz", ".{}.part.npz"])
def test_a_tile_that_a_kill_or_a_power_cut_left_unfinished_is_done_again(tmp_path, survey, share, name):
    source, tiles = survey
    output = OutputFolder(tmp_path / "out", source.inputs, source.frame)
    output.write_tile(products_of(tiles[0]))
    partial = tmp_path / "out" / ".partial"
    whole = (partial / f"{tiles[0].stamp}.npz").read_bytes()
    (partial / f"{tiles[0].stamp}.npz").unlink()
    (partial / name.format(tiles[0].stamp)).write_bytes(whole[: int(share * len(whole))])
    assert OutputFolder(tmp_path / "out", source.inputs, source.frame).on_disk == {}
    assert not list(partial.glob("*.npz"))


def test_products_come_back_from_disk_as_they_were(tmp_path, survey):
    _, tiles = survey
    before = products_of(tiles[0])
    before.save(tmp_path / "a.npz")
    after = load_products(tmp_path / "a.npz")
    for name in ("core", "roofs", "edges"):
        assert np.array_equal(getattr(before, name), getattr(after, name))
    assert (after.stamp, after.features) == (before.stamp, before.features)
    assert after.outlines[0].outline.same_as(before.outlines[0].outline)
    assert after.traced[0].building_id == before.traced[0].building_id


def the_line(*arguments, **options):
    with pytest.raises(OutputError) as caught:
        OutputFolder(*arguments, **options)
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith(f"{arguments[0]}: ")
    return line


def test_other_inputs_or_parameters_do_not_go_on_with_a_run(tmp_path, survey):
    source, _ = survey
    OutputFolder(tmp_path / "out", source.inputs, source.frame, parameters={"a": 1})
    assert "unfinished run" in the_line(
        tmp_path / "out", source.inputs[:1], source.frame, parameters={"a": 1}
    )
    assert "unfinished run" in the_line(tmp_path / "out", source.inputs, source.frame, parameters={"a": 2})
    assert "unfinished run" in the_line(tmp_path / "out", source.inputs, source.frame)
    OutputFolder(tmp_path / "out", source.inputs, source.frame, parameters={"a": 1})


def test_files_of_an_earlier_run_go_when_it_is_replaced(tmp_path, survey):
    source, tiles = survey
    run(tmp_path / "out", source, tiles)
    run(tmp_path / "out", TileSourceLike(source, source.inputs[:1]), tiles[:1], overwrite=True)
    assert [p.name for p in (tmp_path / "out" / "classified").iterdir()] == ["0.laz"]


class TileSourceLike:
    def __init__(self, source, inputs):
        self.inputs, self.frame = inputs, source.frame


def test_the_inputs_own_folder_is_refused(tmp_path, survey):
    source, _ = survey
    (tmp_path / "out" / "classified").mkdir(parents=True)
    path = (tmp_path / "0.las").rename(tmp_path / "out" / "classified" / "0.las")
    line = the_line(tmp_path / "out", [InputFile(path, 600)], source.frame, overwrite=True)
    assert "contains the input" in line
    assert path.exists()


def test_an_input_that_vanished_is_reported_and_the_others_are_written(tmp_path, survey):
    source, tiles = survey
    output = OutputFolder(tmp_path / "out", source.inputs, source.frame)
    for tile in tiles:
        output.write_tile(products_of(tile))
    (tmp_path / "0.las").unlink()
    summary = output.finalise({"problems": ["earlier: one: problem"]})
    assert summary.problems[0] == "earlier: one: problem"
    assert "0.las: no such file" in summary.problems[1]
    assert [p.name for p in (tmp_path / "out" / "classified").iterdir()] == ["1.laz"]


def test_an_input_that_changed_is_not_mixed_with_old_results(tmp_path, survey):
    source, _ = survey
    output = OutputFolder(tmp_path / "out", source.inputs, source.frame)
    cloud_files.saved(cloud_files.random_cloud(30), tmp_path / "0.las")
    assert "changed during" in output.finalise().problems[0]


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
        assert line.endswith("/out: in use by another run: wait for it to end, or choose another folder")
    assert tile.exists()


def test_a_folder_is_free_when_the_run_that_had_it_is_killed(other, tmp_path):
    with pytest.raises(OutputError, match="in use by another run"), sole_use(tmp_path / "out"):
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
