"""The output folder: which folders are taken, tiles on disk, taking up again, and whole files or none."""

import json
import random

import laspy
import numpy as np
import pyogrio
import pytest
from laspy.copc import CopcReader
from support import cloud_files
from support.results import MODELS
from support.saved_tiles import load_products

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.building_model import BuildingModel
from lidar_buildings.io.clouds.input_file import InputFile
from lidar_buildings.io.models.cityjson import feature_line
from lidar_buildings.io.results import building_files
from lidar_buildings.io.results.output_config import OutputConfig
from lidar_buildings.io.results.output_folder import OutputFolder
from lidar_buildings.io.results.run_folder import output_names
from lidar_buildings.io.results.tile_products import TileProducts
from lidar_buildings.io.tiling.tiling import TileSource, TilingConfig
from lidar_buildings.io.vectors.polygon_file import read_polygons

WEST, SOUTH = 85000.0, 447000.0
FILES = ["buildings.gpkg", *MODELS, "classified", "run.json", "tiles3d"]


@pytest.fixture
def survey(tmp_path):
    """Two files side by side, and their tiles."""
    paths = []
    for number in range(2):
        corner = (WEST + 100.0 * number, SOUTH, 0.0)
        cloud = cloud_files.random_cloud(600, point_format=6 * number + 1, corner=corner, seed=number)
        cloud.withheld = np.zeros(600, dtype=np.uint8)  # else they keep their class
        paths.append(
            cloud_files.saved(
                cloud_files.with_geo_keys(cloud, {1024: 1, 3072: 28992}), tmp_path / f"{number}.las"
            )
        )
    source = TileSource(paths, TilingConfig(tile_size=50.0, buffer=10.0, max_buffer=10.0))
    yield source, list(source)
    source.close()


def products_of(tile):
    """Make results up that depend on nothing but the points: those above 10 m are one house's roof."""
    high = tile.points[:, 2] > 10.0
    classified = tile.with_columns(
        classification=np.where(high, 6, 2), height_above_ground=tile.points[:, 2] - 1.0
    )
    roofs = classified.select(high)
    number = 1 + len(tile.points) % 1000
    own = np.where(roofs.points[:, 0] < np.median(roofs.points[:, 0]), number, 0)
    planes = roofs.with_columns(edge=roofs.index % 2, building_id=own, plane_id=np.where(own > 0, 3, 0))
    west, south = (float(c) for c in tile.points[:, :2].min(axis=0))
    ring = np.array([[west, south], [west + 8.0, south], [west + 8.0, south + 6.0], [west, south + 6.0]])
    hole = np.array([[west + 2.0, south + 2.0], [west + 2.0, south + 4.0], [west + 4.0, south + 2.0]])
    one = BuildingOutline(number, Outline(ring, (hole,)))
    model = BuildingModel({}, {"height": 8.5}, (), BuildingStatus.NO_SOLID, "made up")
    line = feature_line(model, number, tile.frame, model.attributes, anchor=(west, south))
    return TileProducts.from_tiles(classified, planes, [one], [one], [line])


def everything(folder):
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }


def run(folder, source, tiles, **options):
    output = OutputFolder(folder, source.inputs, source.frame, **options)
    for tile in tiles:
        output.write_tile(products_of(tile))
    return output.finalise({"versions": {"lidar_buildings": "0"}})


def the_line(*arguments, **options):
    with pytest.raises(OutputError) as caught:
        OutputFolder(*arguments, **options)
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith(f"{arguments[0]}: ")
    return line


def test_a_run_makes_every_file_and_leaves_nothing_else(tmp_path, survey):
    source, tiles = survey
    summary = run(tmp_path / "deep" / "out", source, tiles)
    assert sorted(p.name for p in (tmp_path / "deep" / "out").iterdir()) == FILES
    assert summary.files == (
        "classified/0.laz", "classified/1.laz", "buildings.gpkg", "city_model.city.jsonl", "city_model.obj",
        "city_model.mtl", "city_model.dxf", "tiles3d", "run.json",
    )  # fmt: skip
    assert (summary.n_tiles, summary.n_points, summary.n_unclassified) == (len(tiles), 1200, 0)
    assert sum(summary.classes.values()) == 1200
    assert summary.buildings == {"no_solid": len(tiles)}
    assert summary.problems == ()


def test_points_get_the_results_of_their_own_tile_in_the_order_of_the_file(tmp_path, survey):
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


def test_a_buildings_points_in_another_tiles_core_carry_its_id(tmp_path, survey):
    source, tiles = survey
    run(tmp_path / "out", source, tiles)
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


def test_the_geopackage_holds_every_building_in_source_coordinates(tmp_path, survey):
    source, tiles = survey
    run(tmp_path / "out", source, tiles)
    path = tmp_path / "out" / "buildings.gpkg"
    assert [name for name, _ in pyogrio.list_layers(path)] == [
        "outlines",
        "traced",
        "roof_faces",
        "roof_lines",
    ]
    outlines, columns, crs = read_polygons(path, "outlines")
    assert crs == "EPSG:28992"
    assert len(outlines) == len(tiles)
    assert columns["building_id"].tolist() == sorted(products_of(t).outlines[0].building_id for t in tiles)
    assert set(columns["status"]) == {"no_solid"}
    assert columns["height"] == pytest.approx([8.5] * len(tiles))
    assert all(name.startswith("building-85") for name in columns["readable_id"])
    assert all(len(polygon.interiors) == 1 and polygon.bounds[0] >= WEST for polygon in outlines)
    faces, _, _ = read_polygons(path, "roof_faces")
    assert all(face.has_z for face in faces)


def test_the_city_model_is_a_header_and_the_features_by_building(tmp_path, survey):
    source, tiles = survey
    run(tmp_path / "out", source, tiles)
    header, *features = map(json.loads, (tmp_path / "out" / "city_model.city.jsonl").read_text().splitlines())
    assert header["type"] == "CityJSON"
    numbers = [next(iter(f["CityObjects"].values()))["attributes"]["building_id"] for f in features]
    assert numbers == sorted(products_of(t).outlines[0].building_id for t in tiles)


def test_run_json_tells_inputs_counts_and_what_it_was_told(tmp_path, survey):
    source, tiles = survey
    run(tmp_path / "out", source, tiles)
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
    assert everything(tmp_path / "one") == everything(tmp_path / "two")


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


def test_an_unfinished_run_is_taken_up_again(tmp_path, survey):
    source, tiles = survey
    run(tmp_path / "whole", source, tiles)
    output = OutputFolder(tmp_path / "out", source.inputs, source.frame)
    for tile in tiles[:3]:
        output.write_tile(products_of(tile))
    again = OutputFolder(tmp_path / "out", source.inputs, source.frame)
    assert again.done_stamps().keys() == {tile.stamp for tile in tiles[:3]}
    with TileSource([i.path for i in source.inputs], source.config, skip=again.done_stamps()) as rest:
        for tile in rest:
            again.write_tile(products_of(tile))
    again.finalise({"versions": {"lidar_buildings": "0"}})
    assert everything(tmp_path / "out") == everything(tmp_path / "whole")


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
    assert OutputFolder(tmp_path / "out", source.inputs, source.frame).done_stamps() == {}
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
    assert "holds the input" in line
    assert path.exists()


def test_equal_names_get_numbers(tmp_path):
    names = ["a/x.laz", "b/X.LAS", "c/x.copc.laz", "x_2.las", "y.v1.laz"]
    assert output_names([InputFile(tmp_path / name, 1) for name in names]) == [
        "x",
        "X_2",
        "x_3",
        "x_2_2",
        "y.v1",
    ]


def test_equal_names_of_different_folders_are_both_written(tmp_path, survey):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        cloud_files.saved(cloud_files.random_cloud(50, seed=ord(folder)), tmp_path / folder / "x.laz")
    with TileSource([tmp_path / "a", tmp_path / "b"]) as source:
        run(tmp_path / "out", source, list(source))
        for number, name in enumerate(("x.laz", "x_2.laz")):
            mine = laspy.read(source.inputs[number].path)
            assert np.array_equal(laspy.read(tmp_path / "out" / "classified" / name).X, mine.X)


def test_classified_clouds_are_written_as_copc_on_request(tmp_path, survey):
    source, tiles = survey
    summary = run(tmp_path / "out", source, tiles, files=OutputConfig(formats=["cityjson"], copc=True))
    names = {"copc/0.copc.laz", "copc/1.copc.laz"}
    assert names < set(summary.files)
    with CopcReader.open(tmp_path / "out" / "copc" / "0.copc.laz") as reader:
        found = np.sort(np.asarray(reader.query()["BuildingId"]))
    assert np.array_equal(found, np.sort(laspy.read(tmp_path / "out" / "classified" / "0.laz")["BuildingId"]))
    run(tmp_path / "out", source, tiles, overwrite=True)
    assert not (tmp_path / "out" / "copc").exists()


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
        summary = run(tmp_path / "out", source, list(source))
    assert "tiles3d" not in summary.files
    (line,) = summary.remarks
    assert line.startswith("no 3D Tiles were made: the inputs name no reference system: ")


def test_formats_that_are_not_wanted_are_not_made(tmp_path, survey):
    source, tiles = survey
    summary = run(tmp_path / "out", source, tiles, files=OutputConfig(formats=["cityjson"]))
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [MODELS[0], "classified", "run.json"]
    assert "city_model.city.jsonl" in summary.files
    assert "buildings.gpkg" not in summary.files
    assert summary.buildings == {"no_solid": len(tiles)}


@pytest.mark.parametrize(
    ("until", "files"),
    [
        ("ground_filter", ["classified", "run.json"]),
        ("edge_labelling", ["classified", "run.json"]),
        ("boundary_tracing", ["buildings.gpkg", "classified", "run.json"]),
        ("plane_fitting", ["buildings.gpkg", "classified", "run.json"]),
        ("building_model", FILES),
    ],
)
def test_a_shorter_run_makes_fewer_files(tmp_path, survey, until, files):
    source, tiles = survey
    run(tmp_path / "out", source, tiles, until=until)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == files


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
    assert "has changed" in output.finalise().problems[0]


@pytest.mark.parametrize("part", ["npz", "laz", "results", "jsonl", "run"])
def test_a_full_disk_gives_one_line_and_the_run_can_be_taken_up_again(tmp_path, survey, monkeypatch, part):
    source, tiles = survey
    run(tmp_path / "whole", source, tiles)
    with monkeypatch.context() as full:
        names = {"laz": ".0.part.laz", "run": ".run.part.json"}
        cloud_files.fill_the_disk(full, names.get(part, f"part.{part}"), 100)
        with pytest.raises(OutputError) as caught:
            run(tmp_path / "out", source, tiles)
    line = str(caught.value)
    assert "\n" not in line
    assert "No space left on device" in line
    assert "give the same command again" in line
    left = [p.name for p in (tmp_path / "out").rglob("*") if ".part." in p.name]
    assert left == []
    assert not (tmp_path / "out" / "run.json").exists()
    run(tmp_path / "out", source, tiles)
    assert everything(tmp_path / "out") == everything(tmp_path / "whole")


def test_a_full_disk_in_the_geopackage_keeps_the_tiles(tmp_path, survey, monkeypatch):
    source, tiles = survey
    with monkeypatch.context() as full:

        def fail(path, *_):
            raise OutputError(f"{path}: cannot be written: disk full: check the free space")

        full.setattr(building_files, "write_buildings", fail)
        with pytest.raises(OutputError, match="disk full"):
            run(tmp_path / "out", source, tiles)
    assert OutputFolder(tmp_path / "out", source.inputs, source.frame).done_stamps().keys() == {
        t.stamp for t in tiles
    }


def test_zero_points_give_an_empty_but_complete_output(tmp_path):
    cloud_files.saved(cloud_files.random_cloud(0), tmp_path / "none.laz")
    with TileSource(tmp_path / "none.laz") as source:
        summary = run(tmp_path / "out", source, list(source))
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == FILES[:-1], "3D Tiles have no place"
    assert summary.n_points == 0
    assert len(laspy.read(tmp_path / "out" / "classified" / "none.laz")) == 0
