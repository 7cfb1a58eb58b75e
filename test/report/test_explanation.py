"""What is said of a building leads to what is wrong with it, and to the parameter that would change it."""

import json
import shutil
import sqlite3
from contextlib import closing

import numpy as np
import pytest
import shapely
from support.model_survey import BUILDINGS, DUTCH
from support.pages import Page
from support.result_folders import with_points, written_models

from lidar_buildings.cli import main
from lidar_buildings.report.explain.building_findings import Limits, outline_findings
from lidar_buildings.report.result_folder import GPKG, ReportedBuilding, read_result

SPACING = 0.5
LIMITS = Limits({}, SPACING)
LARGE = {"roof_selection": {"min_building_area": 25.0}}


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("explained") / "out"
    return with_points(written_models(folder, DUTCH, parameters=LARGE), DUTCH)


def explained(capsys, *arguments):
    assert main(["explain", *map(str, arguments)]) == 0
    return capsys.readouterr().out


def said_of(outline, traced=None, status="ok"):
    building = ReportedBuilding("a", {"status": status}, outline, traced)
    findings = list(outline_findings(building, SPACING, LIMITS))
    named = {name for one in findings for name in one.parameters}
    return "\n".join(one.text for one in findings), named


def source(x, y):
    east, north, _ = DUTCH.to_source(np.array([[x, y, 0.0]]))[0]
    return f"{east:.2f},{north:.2f}"


def test_a_lost_dormer_is_found_with_its_place_and_the_limit_that_it_missed(capsys, result):
    text = explained(capsys, result, 5)
    (line,) = [line for line in text.splitlines() if "most of them in no plane" in line]
    assert "0.80 m above it" in line, "one metre upright is 0.8 m at right angles to the roof"
    east, north = source(4.5, 1.5).split(",")
    place = line.split(" at ")[1].split(":")[0].split(", ")
    assert [float(one) for one in place] == pytest.approx([float(east), float(north)], abs=0.3)
    assert "smaller than plane_fitting.min_plane_area (1.5 m²)" in line
    assert "plane_fitting.min_plane_area = 1.5 m²: Smallest plane" in text


def test_planes_are_told_with_points_slope_and_direction(capsys, result):
    text = explained(capsys, result, 5)
    (south, north) = sorted(line for line in text.splitlines() if line.strip().startswith("plane "))[:2]
    assert "slope 37°, faces 180°" in south
    assert "slope 37°, faces 0°" in north


def test_a_run_told_to_end_early_rejected_nothing_and_lacks_no_planes(capsys, result, tmp_path):
    folder = tmp_path / "early"
    shutil.copytree(result, folder)
    run = json.loads((folder / "run.json").read_text())
    for until, name in (("roof_selection", source(15.0, 3.5)), ("regularisation", 5)):
        (folder / "run.json").write_text(json.dumps({**run, "until": until}))
        text = explained(capsys, folder, name)
        assert f"The run ended after {until} (--until)" in text
        assert "High but no roof" not in text
        assert "in no plane" not in text


def test_a_building_without_an_outline_yet_has_the_number_of_its_points(result, tmp_path):
    folder = tmp_path / "traced"
    shutil.copytree(result, folder)
    known = {one.name: one.building_id for one in read_result(folder).buildings if one.traced is not None}
    with closing(sqlite3.connect(folder / GPKG)) as layers, layers:
        layers.execute("DELETE FROM outlines")
    assert {one.name: one.building_id for one in read_result(folder).buildings} == known
    assert 5 in known.values()


def test_a_missing_building_is_explained_by_the_limit_that_it_fails(capsys, result):
    text = explained(capsys, result, source(15.0, 3.5))
    assert "No building at" in text
    (line,) = [line for line in text.splitlines() if "High but no roof" in line]
    assert "smaller than min_building_area" in line
    assert "narrower than min_roof_width" in line, "it is 2 m wide"
    assert "rougher" not in line, "the shed is smooth"
    assert "roof_selection.min_building_area = 25.0 m^2, the default is 12.0" in text


def test_a_shed_is_as_large_where_nothing_lies_round_it(capsys, tmp_path):
    folder = with_points(written_models(tmp_path / "out", DUTCH, parameters=LARGE), DUTCH, has_lawn=False)
    text = explained(capsys, folder, source(15.0, 3.5))
    assert 5.0 <= float(text.split("points on ")[1].split(" m²")[0]) <= 7.5, "it has 6 m²"
    assert "smaller than min_building_area" in text


def test_a_tree_is_foliage_that_no_limit_keeps_out(capsys, result):
    text = explained(capsys, result, source(25.5, 21.5))
    assert "seen as foliage" in text
    assert "roof_selection.max_roughness" not in text


def test_a_place_without_anything_high_says_so(capsys, result):
    text = explained(capsys, result, source(-7.0, 20.0))
    assert "The highest point is 0.00 m above the ground, below min_height." in text


def test_a_place_whose_tile_failed_says_so(capsys, tmp_path):
    folder = with_points(written_models(tmp_path / "out", DUTCH), DUTCH, height=np.nan)
    assert "They are in no finished tile" in explained(capsys, folder, source(15.0, 3.5))


def test_a_place_within_an_outline_means_its_building(capsys, result):
    assert explained(capsys, result, source(5.0, 4.0)) == explained(capsys, result, 5)


def test_a_place_just_beside_an_outline_means_its_building(capsys, result):
    assert explained(capsys, result, source(-0.6, 4.0)) == explained(capsys, result, 5)
    assert "No building at" in explained(capsys, result, source(-7.0, 20.0))


def test_a_building_without_solid_tells_its_reason(capsys, result):
    text = explained(capsys, result, 7)
    assert "degenerate" in text
    assert "reason: no roof points" in text


def test_a_page_of_one_building_shows_it_with_the_text(capsys, result, tmp_path):
    text = explained(capsys, result, 5, "--page", tmp_path / "house.html")
    page = Page.of(tmp_path / "house.html")
    facts = page.data["facts"]
    assert facts["attributes"][facts["focus"]]["building_id"] == 5
    assert len(facts["names"]) < len(BUILDINGS), "what stands far away is left out"
    assert " ".join(text.split("\n  /")[0].split()) in page.words


def test_what_is_no_building_is_refused_in_one_line(capsys, result):
    for name, words in (("999", "no building is called '999'"), ("house", "no building is called 'house'")):
        assert main(["explain", str(result), name]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert words in line
        assert "give a readable_id or a building_id of buildings.gpkg, or X,Y" in line
    assert main(["explain", str(result), source(-7.0, 20.0), "--page", "x.html"]) == 2
    assert "remove --page" in capsys.readouterr().err


def test_a_jagged_outline_names_what_makes_walls_longer():
    teeth = [(k * 0.5, 10.0 + 0.5 * (k % 2)) for k in range(40)]
    text, named = said_of(shapely.Polygon([(0, 0), (20, 0), *teeth[::-1]]))
    assert "Jagged: " in text
    assert {"regularisation.noise", "regularisation.wall_cost"} <= named
    text, named = said_of(shapely.box(0, 0, 20, 10))
    assert "Jagged" not in text
    assert not named


def test_an_outline_that_could_not_be_regularised_says_so():
    text, named = said_of(shapely.box(0, 0, 20, 10), status="traced_outline")
    assert "could not be regularised" in text
    assert "regularisation.noise" in named


def test_a_lost_courtyard_names_the_smallest_one():
    holed = shapely.difference(shapely.box(0, 0, 30, 30), shapely.box(10, 10, 12, 12))
    text, named = said_of(shapely.box(0, 0, 30, 30), holed)
    assert "Traced with 1 courtyard, of which 0 kept" in text
    assert named == {"boundary_tracing.min_courtyard_area"}


def test_parameters_that_were_changed_come_first_with_their_default():
    limits = Limits(json.loads('{"parameters": {"segmentation": {"window": 9.0}}}'), SPACING)
    changed, other = limits.lines(["regularisation.noise", "segmentation.window"])
    assert changed.startswith("segmentation.window = 9.0 spacings, 4.50 m here, the default is 4.5: Sides of")
    assert other.startswith("regularisation.noise = 0.3 spacings, 0.15 m here: Scatter")


def test_what_was_changed_is_told_even_where_no_line_leads_to_it():
    parameters = {"plane_fitting": {"max_plane_distance": 0.9}, "segmentation": {"window": 9.0}}
    limits = Limits({"parameters": parameters}, SPACING)
    (line,) = limits.other_changes(["segmentation.window"])
    assert line == "plane_fitting.max_plane_distance = 0.9 m, the default is 0.18 m"


def test_a_building_tells_what_was_changed_beside_what_bears_on_it(capsys, result):
    last = explained(capsys, result, 5).split("Also changed in this run\n")[1]
    assert last.startswith("  roof_selection.min_building_area = 25.0 m")
