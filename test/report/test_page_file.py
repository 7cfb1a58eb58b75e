"""The page of a result: its data are the files', what is left out is said, nothing comes from elsewhere."""

import json
import re
from argparse import Namespace
from itertools import pairwise

import laspy
import numpy as np
import pyogrio
import pytest
import shapely
from support import model_survey
from support.model_survey import DUTCH, FEET
from support.pages import Page
from support.result_folders import written_models

from lidar_buildings.cli import main
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.results import classified_files
from lidar_buildings.report import contents as contents_module
from lidar_buildings.report.page_file import page_of, write_report
from lidar_buildings.report.result_folder import ReportedBuilding, read_result
from lidar_buildings.report.summary_words import histograms
from lidar_buildings.simulation import simulate_survey


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """A run over a simulated house."""
    folder = tmp_path_factory.mktemp("house")
    simulate_survey(folder / "survey", "single_house", 0, density=4.0)
    arguments = ["--no-ros", "--set", "roof_selection.min_height=2.25"]
    assert main(["run", str(folder / "survey"), "--output", str(folder / "out"), *arguments]) == 0
    return folder / "out"


@pytest.fixture(scope="module")
def page(result):
    return Page.of(result / "report.html")


@pytest.mark.parametrize("frame", [DUTCH, FEET], ids=["metres", "feet"])
def test_triangles_have_the_vertices_and_the_area_of_the_models(tmp_path, frame):
    page = Page(page_of(contents_module.contents_of(read_result(written_models(tmp_path / "out", frame)))))
    names, corners = page.data["facts"]["names"], page.data["vertices"][page.data["triangles"]] / 1000.0
    numbers = [one["building_id"] for one in page.data["facts"]["attributes"]]
    assert sorted(numbers) == sorted(model_survey.BUILDINGS)
    assert len(names) == len(set(names)) == len(numbers)
    found = {}
    for row, level, first, count in page.data["solids"].tolist():
        own = corners[first : first + count]
        signed = np.einsum("ij,ij->i", own[:, 0], np.cross(own[:, 1], own[:, 2])).sum() / 6.0
        found[numbers[row], level] = (np.unique(own.reshape(-1, 3), axis=0), signed)
    expected = {
        (number, round(10 * float(lod))): (np.unique(np.round(solid.vertices, 3), axis=0), solid.volume)
        for number, build in model_survey.BUILDINGS.items()
        for lod, solid in build()[1].solids.items()
    }
    assert found.keys() == expected.keys()
    for key, (vertices, volume) in expected.items():
        np.testing.assert_allclose(found[key][0], vertices, atol=1e-9)
        # whole millimetres; a triangle that looked inwards would take volume away
        assert found[key][1] == pytest.approx(volume, rel=1e-3)


def test_rings_are_those_of_the_layers(tmp_path):
    folder = written_models(tmp_path / "out", DUTCH)
    page = Page(page_of(contents_module.contents_of(read_result(folder))))
    rings = page.data["rings"]
    for layer, kind in (("outlines", 0), ("traced", 1)):
        _, _, geometry, _ = pyogrio.raw.read(folder / "buildings.gpkg", layer=layer)
        polygons = shapely.from_wkb(geometry)
        assert sum(rings[:, 1] == kind) == sum(1 + len(one.interiors) for one in polygons)
        parts = [
            page.data["ring_vertices"][first : first + n] / 1000.0
            for _, of, first, n in rings.tolist()
            if of == kind
        ]
        area = shapely.area(shapely.polygons(parts[0]))
        assert area == pytest.approx(polygons[0].area, rel=1e-4)


def test_points_are_those_of_the_clouds_with_class_building_and_plane(page, result):
    read = laspy.read(result / "classified" / "strip_01.laz")
    frame = read_result(result).frame
    every = frame.to_map(np.asarray(read.xyz))
    is_shown = ~np.isin(read.classification, (7, 18))
    assert len(page.places) == is_shown.sum(), "the budget is larger than this cloud"
    order, mine = (np.lexsort(one.round(1).T) for one in (every[is_shown], page.places))
    assert np.abs(every[is_shown].min(axis=0) - page.places.min(axis=0)).max() < 1e-3
    assert len(order) == len(mine)
    classes = np.bincount(page.data["classes"] & 127, minlength=19)
    assert classes.tolist() == np.bincount(np.asarray(read.classification)[is_shown], minlength=19).tolist()
    assert (page.data["classes"] >= 128).sum() == (np.asarray(read["Facade"])[is_shown] > 0).sum()
    assert (page.data["building"] == 1).sum() == (np.asarray(read["BuildingId"])[is_shown] > 0).sum()
    assert (np.diff(page.data["building"].astype(int)) >= 0).all(), "sorted by building"
    roof = page.data["building"] == 1
    high = np.asarray(read["BuildingId"]) > 0
    np.testing.assert_allclose(page.places[roof].mean(axis=0), every[high].mean(axis=0), atol=1e-3)


@pytest.mark.parametrize(("scale", "expected"), [(257, 200), (1, 200), (0, None)])
def test_colours_of_points_are_bytes_where_the_cloud_has_any(tmp_path, scale, expected):
    cloud = laspy.create(point_format=7, file_version="1.4")
    cloud.xyz, cloud.classification = np.eye(3), [2, 2, 2]
    cloud.red = cloud.green = cloud.blue = np.array([0, 1, 200]) * scale
    cloud.write(tmp_path / "a.las")
    frame = MapFrame("", (0.0, 0.0, 0.0))
    shown = contents_module.read_shown_points([tmp_path / "a.las"], frame, {2: 3}, {}, None, 10)
    assert (shown.colours is None) if expected is None else (shown.colours.max() == expected)


def test_terrain_has_the_elevations_of_the_raster(page, result):
    import rasterio

    known = page.data["facts"]["terrain"]
    steps = page.data["terrain"]
    with rasterio.open(result / "dtm.tif") as file:
        raster = file.read(1, masked=True)
        west, north = file.transform.c, file.transform.f
    assert steps.shape == raster.shape
    assert ((steps == known["unknown"]) == np.ma.getmaskarray(raster)).all()
    elevations = known["middle"] + steps * known["step"]
    assert np.abs(elevations - raster).max() <= known["step"]
    origin = page.data["facts"]["origin"]
    assert (known["west"] + origin[0], known["north"] + origin[1]) == pytest.approx((west, north))


def test_the_top_says_what_came_in_what_came_out_how_sure_and_how_long(page, result):
    told = json.loads((result / "run.json").read_text())
    for words in (
        f"{told['n_points']:,} points in 1 file (strip_01.laz)",
        f"1 building (1 {next(iter(told['quality']))}); 1 with LoD2.2",
        "1 of 1 with valid solids",
        f"{told['seconds']['wall']:,.1f} s",
    ):
        assert words in page.words
    assert "roof_selection.min_height 2.25 m 2.0 m" in page.words, "a parameter that differs, and its default"
    assert "segmentation.window" not in page.words


def test_the_first_screen_has_four_figures_and_shows_no_points(page, result):
    (known,) = page.data["facts"]["attributes"]
    first = page.words.split("Layers")[0]
    grade = next(iter(json.loads((result / "run.json").read_text())["quality"]))
    for words in (
        "Buildings 1 1 with valid solids",
        f"Footprints and volume {known['area']:,.0f} m² {known['volume']:,.0f} m³",
        "Grades 1 good" if grade == "good" else f"Grades 0 good 1 {grade}",
        f"Accuracy {known['rmse']:.2f} m",
    ):
        assert words in first
    assert 'id="show-points">' in page.text, "not checked"


def test_links_lead_to_parts_of_the_page_and_to_files_beside_it(page, result):
    inner = [one[1:] for one in page.links if one.startswith("#")]
    assert set(inner) <= set(page.ids)
    files = [one for one in page.links if not one.startswith("#")]
    assert files == json.loads((result / "run.json").read_text())["files"]
    assert all((result / one).exists() for one in files)


def test_scripts_use_only_ids_that_the_page_has(page):
    used = set(re.findall(r'byId\("([\w-]+)"\)', page.text))
    assert len(used) > 20
    assert used <= set(page.ids)


def test_bins_of_histograms_count_every_building_where_it_belongs():
    values = [0.01, 0.05, 0.05, 0.11, *[0.07] * 96, 9.0]
    buildings = [ReportedBuilding(str(row), {"rmse": value}) for row, value in enumerate(values)]
    (told,) = histograms(Namespace(buildings=buildings, unit=1.0))
    edges = told["from"] + told["step"] * np.arange(len(told["counts"]) + 1)
    assert sum(told["counts"]) + told["beyond"] == len(values)
    assert told["beyond"] == sum(value > edges[-1] for value in values)
    expected = [sum(low <= value < high for value in values) for low, high in pairwise(np.round(edges, 9))]
    assert told["counts"][:-1] == expected[:-1]


def test_the_page_is_one_of_the_runs_files_and_fetches_nothing(page, result):
    assert "report.html" in json.loads((result / "run.json").read_text())["files"]
    assert page.addresses() == []
    assert "default-src 'none'" in page.text


def test_a_page_made_later_is_the_same(result, page, tmp_path, capsys):
    assert main(["report", str(result)]) == 0
    assert capsys.readouterr().out.strip() == str(result / "report.html")
    assert (result / "report.html").read_text(encoding="utf-8") == page.text


def test_budgets_hold_and_what_is_left_out_is_said(result, tmp_path, monkeypatch):
    monkeypatch.setattr(contents_module, "MOST_POINTS", 500)
    monkeypatch.setattr(contents_module, "MOST_CELLS", 20)
    page = Page(page_of(contents_module.contents_of(read_result(result))))
    assert 200 < len(page.data["points"]) <= 500
    assert (page.data["building"] > 0).mean() > 0.2, "points of buildings come first"
    assert max(page.data["terrain"].shape) == 20
    assert "points are shown, more of buildings than of the rest" in page.words
    monkeypatch.setattr(contents_module, "MOST_BUILDINGS", 2)
    monkeypatch.setattr(contents_module, "MOST_TRIANGLES", 12)
    monkeypatch.setattr(contents_module, "worst_buildings", lambda *_: [])
    page = Page(page_of(contents_module.contents_of(read_result(written_models(tmp_path / "out", DUTCH)))))
    assert len(page.data["facts"]["names"]) == 2
    assert len(page.data["dots"]) == len(model_survey.BUILDINGS) - 2
    assert "dots for 3 others" in page.words
    assert "Shown as outlines only, to keep the page small: 1 building." in page.words


def test_of_large_clouds_stretches_are_read(result, monkeypatch):
    whole = len(contents_module.contents_of(read_result(result)).points.steps)
    monkeypatch.setattr(classified_files, "MOST_READ", whole // 3)
    monkeypatch.setattr(classified_files, "_STRETCH", 100)
    few = contents_module.contents_of(read_result(result)).points
    assert 0.2 * whole < len(few.steps) < 0.5 * whole


def test_without_layers_the_buildings_are_those_of_the_city_model(tmp_path):
    folder = written_models(tmp_path / "out", DUTCH, formats=("cityjson",))
    page = Page(page_of(contents_module.contents_of(read_result(folder))))
    assert len(page.data["facts"]["names"]) == len(model_survey.BUILDINGS)
    assert len(page.data["solids"])
    assert len(page.data["rings"]) == 0
    assert "There is no buildings.gpkg, so the map shows no outlines" in page.words


def test_the_worst_come_first_with_their_reason(tmp_path):
    page = Page(page_of(contents_module.contents_of(read_result(written_models(tmp_path / "out", DUTCH)))))
    first = page.data["facts"]["worst"][0]
    assert page.data["facts"]["attributes"][first["row"]]["status"] == "degenerate"
    assert "no roof points" in first["why"]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"until": "roof_selection"}, "The run ended after roof_selection (--until)"),
        ({}, "There are no rasters, so the terrain is not shown."),
        ({"problems": ["a.laz: is <cut> short"]}, "a.laz: is <cut> short"),
        ({"remarks": [{"code": "a_word", "text": "b.laz: steps of 1 m"}]}, "b.laz: steps of 1 m"),
        ({"failed_tiles": [{"tile": 7, "reason": "no memory"}]}, "tile 7 failed: no memory"),
        ({"n_unclassified": 1200}, "1,200 points are in no finished tile"),
        ({"files": ["run.json"]}, "No building was found."),
    ],
)
def test_what_is_missing_or_failed_is_said(tmp_path, more, words):
    folder = written_models(tmp_path / "out", DUTCH, **more)
    page = Page.of(write_report(folder))
    assert words in page.words


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "contains no run.json: give the output folder of a finished run"),
        ("{", "cannot be read"),
        ("[]", "is not the record of a run"),
        ('{"files": []}', "does not say where the map frame lies"),
    ],
)
def test_a_folder_without_a_result_is_refused_in_one_line(tmp_path, capsys, content, words):
    if content is not None:
        (tmp_path / "run.json").write_text(content)
    assert main(["report", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"lidar-buildings: {tmp_path}")
    assert words in line
    assert main(["report", str(tmp_path / "nowhere")]) == 2
    assert "no such folder" in capsys.readouterr().err
