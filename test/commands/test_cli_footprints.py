"""``lidar-buildings run --footprints``: given outlines in, one building each out."""

import json

import numpy as np
import pyproj
import pytest
import shapely
from support.cli_runs import SMALL_TILES, Command
from support.vector_files import write_vectors

from lidar_buildings.cli import main
from lidar_buildings.io.vectors.layers import read_polygons
from lidar_buildings.simulation import simulate_survey


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    """A survey of one house, with its footprint in two halves, one on open ground, and one far away."""
    folder = tmp_path_factory.mktemp("house")
    simulate_survey(folder, "single_house", 0, density=3.0)
    (outline,), _, crs = read_polygons(folder / "truth.gpkg", "outlines")
    corners = shapely.get_coordinates(outline)
    middle = corners[:4].mean(axis=0)
    one, other = 0.5 * (corners[0] + corners[1]), 0.5 * (corners[2] + corners[3])
    halves = [
        shapely.Polygon([corners[0], one, middle, other, corners[3]]),
        shapely.Polygon([one, corners[1], corners[2], other, middle]),
    ]
    west, south, _, _ = outline.bounds
    ground = shapely.box(west - 12, south - 12, west - 8, south - 9)
    far = shapely.box(west + 500, south, west + 510, south + 10)
    names = ["one half", "other half", "no building", "far away"]
    write_vectors(folder / "given.gpkg", [*halves, ground, far], crs=crs, columns={"name": names})
    turn = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform
    degrees = [shapely.transform(s, lambda xy: np.column_stack(turn(*xy.T))) for s in (far, ground, *halves)]
    turned = {"name": [names[k] for k in (3, 2, 0, 1)]}
    write_vectors(folder / "degrees.shp", degrees, crs="EPSG:4326", columns=turned)
    return folder


def run(house, folder, *options, file="given.gpkg"):
    given = ["--footprints", str(house / file), "--footprint-id", "name"]
    cloud = str(house / "strip_01.laz")
    assert main(["run", cloud, "--output", str(folder), "--no-ros", *given, *options]) == 0
    return folder


@pytest.fixture(scope="module")
def result(house, tmp_path_factory):
    return run(house, tmp_path_factory.mktemp("result") / "out")


def buildings(folder):
    """Footprint id → (polygon, attributes)."""
    polygons, columns, _ = read_polygons(folder / "buildings.gpkg", "outlines")
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    return {row["footprint_id"]: (shape, row) for shape, row in zip(polygons, rows, strict=True)}


def test_every_footprint_inside_the_data_becomes_one_building_with_its_name_and_its_outline(house, result):
    found = buildings(result)
    given, columns, _ = read_polygons(house / "given.gpkg")
    assert sorted(found) == ["no building", "one half", "other half"]
    for polygon, name in zip(given, columns["name"], strict=True):
        if name in found:
            assert shapely.hausdorff_distance(found[name][0], polygon) < 0.001
    told = json.loads((result / "run.json").read_text())["footprints"]
    assert (told["n_read"], told["n_used"], told["n_outside"]) == (4, 4, 1)


def test_both_halves_of_a_house_have_their_points_and_a_model(result):
    found = buildings(result)
    for name in ("one half", "other half"):
        _, row = found[name]
        assert row["status"] == "ok"
        assert row["n_points"] > 150
        assert row["lod"] == "2.2"


def test_a_footprint_without_a_building_is_there_with_its_reason(result):
    _, row = buildings(result)["no building"]
    assert row["status"] == "degenerate"
    assert "no roof points" in row["reason"]
    assert row["n_points"] == 0
    assert 99.0 < row["ground_elevation"] < 103.0


def test_a_strict_run_is_done_and_ends_with_four_if_a_building_is_not_good(house, result, tmp_path, capfd):
    command, given = Command(capfd), ["--footprints", house / "given.gpkg", "--footprint-id", "name"]
    spoken = command("run", house / "strip_01.laz", "--output", tmp_path, "--no-ros", *given, "--strict")
    assert spoken.status == 4
    assert spoken.err == [
        "lidar-buildings: --strict: 1 of 3 buildings not good: look at their quality_reasons in the report"
    ]
    assert (tmp_path / "buildings.gpkg").is_file()
    assert json.loads((tmp_path / "run.json").read_text())["quality"] == {"good": 2, "poor": 1}
    assert buildings(result)["no building"][1]["quality_reasons"] == "no_model: no roof points"


def test_neither_tiles_nor_format_nor_reference_system_nor_order_change_ids_and_outlines(
    house, result, tmp_path
):
    until = ["--until", "regularisation"]
    expected = buildings(result)
    other = buildings(run(house, tmp_path / "out", *SMALL_TILES, *until, file="degrees.shp"))
    assert sorted(other) == sorted(expected)
    for name, (polygon, row) in expected.items():
        assert other[name][1]["building_id"] == row["building_id"]
        assert other[name][1]["readable_id"] == row["readable_id"]
        assert shapely.hausdorff_distance(other[name][0], polygon) <= 0.0015


def test_a_run_says_what_became_of_the_footprints(house, tmp_path, capfd):
    command = Command(capfd, "--no-ros", "--until", "boundary_tracing")
    spoken = command(
        "run", house / "strip_01.laz", "--output", tmp_path / "out", "--footprints", house / "given.gpkg"
    )
    assert (spoken.status, spoken.err) == (0, [])
    assert "footprints: 4 read, 1 outside the points" in spoken.out


def test_footprints_that_cannot_be_used_are_refused_before_anything_is_written(house, tmp_path, capfd):
    command = Command(capfd, "--no-ros")
    cloud, out = house / "strip_01.laz", tmp_path / "out"
    text = tmp_path / "text.gpkg"
    text.write_text("nothing")
    far = write_vectors(tmp_path / "far.gpkg", [shapely.box(0, 0, 9, 9)], crs=None, columns={"name": ["far"]})
    column = ["--footprints", house / "given.gpkg", "--footprint-id", "nr"]
    layer = ["--footprints", house / "given.gpkg", "--footprints-layer", "trees"]
    for options, words in (
        (["--footprints", tmp_path / "nowhere.gpkg"], "no such file"),
        (["--footprints", text], "cannot be read as a file of polygons"),
        (column, "has no column 'nr': its columns are name"),
        (layer, "has no layer 'trees': its layers are given"),
        (["--footprint-id", "nr"], "needs --footprints FILE"),
        (["--set", "footprints.file=a.gpkg"], "is set by --footprints"),
    ):
        assert words in command.refused("run", cloud, "--output", out, *options)
    spoken = command("run", cloud, "--output", out, "--footprints", far)
    assert spoken.status == 2
    assert "no footprint lies within the clouds" in spoken.err[-1]
    assert not out.exists()
