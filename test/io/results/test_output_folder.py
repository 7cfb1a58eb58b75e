"""The output folder: which files a run makes, and what they hold."""

import json
import random
from dataclasses import replace

import laspy
import numpy as np
import pyogrio
import pytest
from support import cloud_files
from support.cut_surveys import tiles_of
from support.made_results import bytes_of, products_of, run
from support.results import MODELS

from lidar_buildings.core.model.remarks import Remark
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.io.clouds.find_inputs import InputFile
from lidar_buildings.io.files.atomic_files import compact_json
from lidar_buildings.io.results.output_config import OutputConfig
from lidar_buildings.io.results.output_folder import OutputFolder
from lidar_buildings.io.results.run_folder import output_names
from lidar_buildings.io.results.tile_products import TileProducts
from lidar_buildings.io.tiling.tiling import TileSource
from lidar_buildings.io.vectors.layers import read_polygons

FILES = ["buildings.gpkg", *MODELS, "classified", "run.json", "tiles3d"]


def test_a_run_makes_every_file_and_leaves_nothing_else(tmp_path, survey):
    source, tiles = survey
    summary = run(tmp_path / "deep" / "out", source, tiles)
    assert sorted(p.name for p in (tmp_path / "deep" / "out").iterdir()) == FILES
    assert summary.files == (
        "classified/0.laz", "classified/1.laz", "buildings.gpkg", "city_model.city.jsonl",
        "city_model.city.json", "city_model.obj", "city_model.mtl", "city_model.dxf", "tiles3d", "run.json",
    )  # fmt: skip
    assert (summary.n_tiles, summary.n_points, summary.n_unclassified) == (len(tiles), 1200, 0)
    assert sum(summary.classes.values()) == 1200
    assert summary.buildings == {"no_solid": len(tiles)}
    assert summary.problems == ()


def test_points_get_their_tiles_results_and_the_ids_of_buildings_also_of_other_tiles(tmp_path, survey):
    source, tiles = survey
    run(tmp_path / "out", source, tiles)
    for number in range(2):
        before = laspy.read(source.inputs[number].path)
        after = laspy.read(tmp_path / "out" / "classified" / f"{number}.laz")
        assert np.array_equal(after.X, before.X)
        assert np.array_equal(after.gps_time, before.gps_time)
        high = np.asarray(before.z).astype(np.float32) > 10.0
        assert np.array_equal(after.classification == 6, high)
        assert np.allclose(after["HeightAboveGround"], np.asarray(before.z) - 1.0, atol=1e-5)
        assert np.array_equal(after["EdgeLabel"], np.where(high, np.arange(600) % 2, 0))
    found = [laspy.read(tmp_path / "out" / "classified" / f"{n}.laz") for n in range(2)]
    expected = [np.zeros(600, dtype=np.uint32) for _ in range(2)]
    for tile in sorted(tiles, key=lambda tile: tile.stamp):
        rows = products_of(tile).roofs
        for number in range(2):
            mine = rows[rows["source"] == number]
            expected[number][mine["index"]] = mine["building_id"]
    assert any(
        (
            products_of(t).roofs["index"].size
            > np.isin(t.index[t.is_core], products_of(t).roofs["index"]).sum()
        )
        for t in tiles
    )
    for number in range(2):
        assert np.array_equal(found[number]["BuildingId"], expected[number])
        assert np.array_equal(found[number]["PlaneId"], np.where(expected[number] > 0, 3, 0))


def test_the_files_hold_every_building_and_what_the_run_was_told(tmp_path, survey):
    source, tiles = survey
    run(tmp_path / "out", source, tiles)
    path = tmp_path / "out" / "buildings.gpkg"
    assert [name for name, _ in pyogrio.list_layers(path)] == [
        "outlines",
        "traced",
        "roof_faces",
        "roof_lines",
        "roof_corners",
        "layer_styles",
    ]
    outlines, columns, crs = read_polygons(path, "outlines")
    assert crs == "EPSG:28992"
    assert len(outlines) == len(tiles)
    assert columns["building_id"].tolist() == sorted(products_of(t).outlines[0].building_id for t in tiles)
    assert set(columns["status"]) == {"no_solid"}
    assert columns["height"] == pytest.approx([8.5] * len(tiles))
    assert all(name.startswith("building-85") for name in columns["readable_id"])
    assert all(len(polygon.interiors) == 1 and polygon.bounds[0] >= 85_000.0 for polygon in outlines)
    faces, _, _ = read_polygons(path, "roof_faces")
    assert all(face.has_z for face in faces)
    header, *features = map(json.loads, (tmp_path / "out" / "city_model.city.jsonl").read_text().splitlines())
    assert header["type"] == "CityJSON"
    numbers = [next(iter(f["CityObjects"].values()))["attributes"]["building_id"] for f in features]
    assert numbers == sorted(products_of(t).outlines[0].building_id for t in tiles)
    told = json.loads((tmp_path / "out" / "run.json").read_text())
    assert [i["output"] for i in told["inputs"]] == ["classified/0.laz", "classified/1.laz"]
    assert told["versions"] == {"lidar_buildings": "0"}
    assert told["classes"].keys() == {"2", "6"}
    assert told["set_aside"] == {}
    assert told["n_unclassified"] == 0


def test_the_result_does_not_depend_on_the_order_of_tiles_nor_on_their_coming_twice(tmp_path, survey):
    source, tiles = survey
    run(tmp_path / "one", source, tiles)
    shuffled = tiles * 2
    random.Random(3).shuffle(shuffled)
    run(tmp_path / "two", source, shuffled)
    assert bytes_of(tmp_path / "one") == bytes_of(tmp_path / "two")


def test_points_of_tiles_that_failed_keep_their_class_and_are_counted(tmp_path, survey):
    source, tiles = survey
    summary = run(tmp_path / "out", source, tiles[1:])
    lost = tiles[0]
    assert summary.n_unclassified == lost.is_core.sum() > 0
    number = int(lost.source[lost.is_core][0])
    rows = lost.index[lost.is_core & (lost.source == number)]
    before = laspy.read(source.inputs[number].path)
    after = laspy.read(tmp_path / "out" / "classified" / f"{number}.laz")
    assert np.array_equal(after.classification[rows], before.classification[rows])


def test_a_tile_without_roofs_or_without_points_is_legal(tmp_path, survey):
    source, _ = survey
    output = OutputFolder(tmp_path / "out", source.inputs, source.frame)
    nothing = PointTile(np.empty((0, 3)), source=np.empty(0), index=np.empty(0), stamp=5)
    output.write_tile(TileProducts.from_tiles(nothing))
    summary = output.finalise()
    assert (summary.n_tiles, summary.n_unclassified, summary.buildings) == (1, 1200, {})


def test_points_without_names_are_a_mistake():
    with pytest.raises(ValueError, match="source is missing"):
        TileProducts.from_tiles(PointTile(np.zeros((1, 3))))


def test_equal_names_get_numbers_and_are_all_written(tmp_path, survey):
    names = ["a/x.laz", "b/X.LAS", "c/x.copc.laz", "x_2.las", "y.v1.laz"]
    assert output_names([InputFile(tmp_path / name, 1) for name in names]) == [
        "x",
        "X_2",
        "x_3",
        "x_2_2",
        "y.v1",
    ]
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        cloud_files.saved(cloud_files.random_cloud(50, seed=ord(folder)), tmp_path / folder / "x.laz")
    with TileSource([tmp_path / "a", tmp_path / "b"]) as source:
        run(tmp_path / "out", source, list(tiles_of(source)))
        for number, name in enumerate(("x.laz", "x_2.laz")):
            mine = laspy.read(source.inputs[number].path)
            assert np.array_equal(laspy.read(tmp_path / "out" / "classified" / name).X, mine.X)


def test_more_buildings_than_a_file_may_hold_are_written_in_blocks_and_replaced(tmp_path, survey):
    source, tiles = survey
    few = OutputConfig(max_buildings_per_file=1)
    summary = run(tmp_path / "out", source, tiles, files=few)
    names = ["blocks", "classified", "run.json", "tiles3d"]
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == names
    assert summary.buildings == {"no_solid": len(tiles)}
    run(tmp_path / "out", source, tiles, overwrite=True)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == FILES


def test_without_a_reference_system_there_are_no_3d_tiles_and_one_line_says_so(tmp_path):
    cloud = cloud_files.saved(cloud_files.random_cloud(50), tmp_path / "x.las")
    with TileSource([cloud]) as source:
        summary = run(tmp_path / "out", source, list(tiles_of(source)))
    assert "tiles3d" not in summary.files
    (line,) = summary.remarks
    assert line.code == "no_tiles3d"
    assert line.text.startswith("no 3D Tiles were made: the inputs name no reference system: ")


def test_buildings_coarser_than_the_finest_level_are_told(tmp_path, survey):
    source, tiles = survey
    output = OutputFolder(tmp_path / "out", source.inputs, source.frame)
    for number, tile in enumerate(tiles):
        products = products_of(tile)
        (line,) = products.features
        feature = json.loads(line)
        (building,) = feature["CityObjects"].values()
        building["attributes"] |= {"lod": "2.2" if number == 0 else "1.2"}
        output.write_tile(replace(products, features=[compact_json(feature)]))
    assert output.finalise().remarks[-1:] == (
        Remark("coarser_models", f"coarser than LoD2.2: {len(tiles) - 1} at LoD1.2: their `reason` says why"),
    )


def test_formats_that_are_not_wanted_are_not_made(tmp_path, survey):
    source, tiles = survey
    summary = run(tmp_path / "out", source, tiles, files=OutputConfig(formats=["cityjson"]))
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [*MODELS[:2], "classified", "run.json"]
    assert "city_model.city.jsonl" in summary.files
    assert "buildings.gpkg" not in summary.files
    assert summary.buildings == {"no_solid": len(tiles)}


def test_a_shorter_run_measures_outlines_without_models(tmp_path, survey):
    source, tiles = survey
    output = OutputFolder(tmp_path / "out", source.inputs, source.frame, until="regularisation")
    whole = products_of(tiles[0])
    output.write_tile(
        TileProducts(whole.stamp, whole.core, whole.roofs, whole.edges, whole.traced, whole.outlines)
    )
    output.finalise()
    _, columns, _ = read_polygons(tmp_path / "out" / "buildings.gpkg", "outlines")
    assert columns["area"] == pytest.approx([8.0 * 6.0 - 2.0])
    assert columns["readable_id"][0].startswith("building-85")
