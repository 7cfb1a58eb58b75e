"""``lidar-buildings score outlines --merge-touching``."""

import pytest
from shapely import box
from support.score_files import write_polygons

from lidar_buildings.cli import main
from lidar_buildings.evaluation.command.score import run_score


@pytest.fixture
def folders(tmp_path):
    """The output of a run that took three touching houses for one, and the truth of its survey."""
    write_polygons(tmp_path / "run" / "buildings.gpkg", [box(0, 0, 18, 10), box(40, 0, 50, 10)])
    houses = [box(west, 0, west + 6, 10) for west in (0, 6, 12)]
    write_polygons(tmp_path / "survey" / "truth.gpkg", [*houses, box(40, 0, 50, 10)])
    return tmp_path / "run", tmp_path / "survey"


def test_touching_houses_are_compared_as_blocks_on_request(folders):
    apart = run_score("outlines", *folders).figures
    assert (apart["n_found"], apart["n_reference"]) == (1, 4)
    together = run_score("outlines", *folders, merge_touching=True).figures
    assert (together["n_found"], together["n_reference"], together["n_result"]) == (2, 2, 2)
    assert together["mean_iou"] == pytest.approx(1.0)
    for figures in (apart, together):
        assert figures["covered_share"] == 1.0


def test_the_command_says_that_it_merged_and_how_many_buildings_are_covered(folders, capsys):
    assert main(["score", "outlines", *map(str, folders), "--merge-touching"]) == 0
    title, *lines = capsys.readouterr().out.splitlines()
    assert title.endswith("touching ones merged into blocks")
    figures = dict(line.split() for line in lines)
    assert (figures["n_found"], figures["covered_share"]) == ("2", "1.0000")


@pytest.mark.parametrize("kind", ["ground", "buildings"])
def test_other_kinds_have_nothing_to_merge(folders, capsys, kind):
    assert main(["score", kind, *map(str, folders), "--merge-touching"]) == 2
    assert "--merge-touching does not apply" in capsys.readouterr().err
