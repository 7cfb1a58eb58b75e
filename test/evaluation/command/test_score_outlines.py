"""``lidar-buildings score outlines``: corners, angles and unions."""

import json

import pytest
from shapely import box
from support.score_files import write_polygons
from support.source_tree import ROOT

from lidar_buildings.cli import main
from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.evaluation.command.score import run_score


@pytest.fixture
def run(tmp_path):
    """A run with a house moved by 0.5 m and an invented one, and the map of its survey."""
    write_polygons(tmp_path / "run" / "buildings.gpkg", [box(0.5, 0, 10.5, 10), box(40, 0, 50, 10)])
    return tmp_path / "run", write_polygons(tmp_path / "map.gpkg", [box(0, 0, 10, 10)])


def test_corners_angles_and_unions_are_given(run):
    figures = run_score("outlines", *run).figures
    assert figures["f1"] == pytest.approx(2 / 3)
    assert (figures["corner_n_result"], figures["corner_n_reference"], figures["corner_n_matched"]) == (
        8,
        4,
        4,
    )
    assert (figures["corner_precision"], figures["corner_recall"]) == (0.5, 1.0)
    assert figures["corner_mean_distance"] == pytest.approx(0.5)
    assert figures["angle_percentile_95_deg"] == pytest.approx(0.0, abs=1e-9)
    assert (figures["angle_matched_share"], figures["boundary_hausdorff"]) == (1.0, pytest.approx(0.5))
    assert figures["boundary_of_unions_hausdorff"] == pytest.approx(40.0)
    assert (figures["n_vertices_result"], figures["n_vertices_reference"]) == (8, 4)


def test_the_corner_tolerance_is_an_option(run, capsys):
    assert run_score("outlines", *run, corner_tolerance=0.3).figures["corner_n_matched"] == 0
    assert main(["score", "outlines", *map(str, run), "--corner-tolerance", "0.3", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert (figures["corner_tolerance"], figures["corner_recall"]) == (0.3, 0.0)
    with pytest.raises(ParameterError, match="--corner-tolerance 0"):
        run_score("outlines", *run, corner_tolerance=0.0)
    assert main(["score", "buildings", *map(str, run), "--corner-tolerance", "1"]) == 2
    assert "--corner-tolerance does not apply to buildings" in capsys.readouterr().err


def test_every_figure_is_explained(run, tmp_path):
    survey = tmp_path / "survey.gpkg"
    write_polygons(survey, [box(0, 0, 10, 10)])
    figures = run_score("outlines", run[0], survey, merge_touching=True).figures
    page = (ROOT / "doc" / "scores.md").read_text(encoding="utf-8")
    assert [name for name in figures if f"`{name}`" not in page] == []
