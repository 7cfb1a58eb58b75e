"""The rasters of a run: tiles put together, units and reference systems, surveys in two places."""

import json
import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
import pytest
import rasterio
from support import cloud_files
from support.saved_tiles import load_products

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.terrain.config import RasterConfig
from lidar_buildings.core.stages.terrain.rasters import TerrainRasters
from lidar_buildings.core.stages.terrain.window import RasterWindow
from lidar_buildings.io.clouds.agreement import crs_with_heights
from lidar_buildings.io.clouds.find_inputs import InputFile
from lidar_buildings.io.clouds.las import open_cloud
from lidar_buildings.io.results.output_folder import OutputFolder
from lidar_buildings.io.results.terrain_files import RASTERS, merged, terrain_meshes, write_rasters
from lidar_buildings.io.results.tile_products import TileProducts, load_raster_window
from lidar_buildings.pipeline.tile_stages import rasterise_tile

SURVEY_FOOT = 1200 / 3937
DUTCH = MapFrame("EPSG:28992", (85_000.0, 447_000.0, 0.0))


def sloping(corner, frame=DUTCH, size=20.0, stamp=1, n=900):
    """A tile of ground that rises by one in ten towards the east."""
    xy = np.random.default_rng(stamp).uniform(0.0, size, (n, 2)) + corner
    points = np.column_stack((xy, 5.0 + 0.1 * xy[:, 0]))
    numbers = {"source": np.zeros(n), "index": np.arange(n)}
    return PointTile(points, classification=np.full(n, 2), stamp=stamp, frame=frame, **numbers)


def saved(folder, tile, config=None, frame=DUTCH):
    rasters = rasterise_tile(tile, config or RasterConfig(), frame)
    path = folder / f"{tile.stamp}.npz"
    TileProducts.from_tiles(tile, rasters=rasters).save(path)
    return path


def test_rasters_come_back_from_disk_as_they_were(tmp_path):
    tile = sloping((3.0, 4.0))
    rasters = rasterise_tile(tile, RasterConfig(), DUTCH)
    after = load_products(saved(tmp_path, tile)).rasters
    assert after.window == rasters.window
    for name in ("dtm", "dsm", "distance"):
        np.testing.assert_array_equal(getattr(after, name), getattr(rasters, name))
    TileProducts.from_tiles(tile).save(tmp_path / "without.npz")
    assert load_raster_window(tmp_path / "without.npz") is None
    assert load_products(tmp_path / "without.npz").rasters is None


def test_the_terrains_triangles_are_the_same_however_it_is_cut_into_tiles(tmp_path):
    # x = 85,017 and 447,0xx lie amid squares of 256 m: their common side is at x = 84,992
    frame = MapFrame("EPSG:28992", (84_900.0, 447_000.0, 0.0))
    whole = sloping((80.0, 20.0), frame, size=24.0, n=4000)
    is_west = whole.points[:, 0] < 95.0
    parts = [
        saved(tmp_path, replace(whole, buffer=(is_west == own).astype(np.uint8), stamp=stamp), frame=frame)
        for stamp, own in ((5, True), (6, False))
    ]
    found = [
        list(terrain_meshes(each, frame, 0.05)) for each in (parts, [saved(tmp_path, whole, frame=frame)])
    ]
    assert [one.name for one in found[0]] == ["terrain-84736.0-447232.0", "terrain-84992.0-447232.0"]
    for mine, theirs in zip(*found, strict=True):
        # the ground across a seam is the same but for rounding
        np.testing.assert_allclose(mine.vertices, theirs.vertices, atol=1.5e-3)
        np.testing.assert_array_equal(mine.triangles, theirs.triangles)
    for mesh in found[0]:
        assert mesh.vertices[:, 2] == pytest.approx(5.0 + 0.1 * mesh.vertices[:, 0], abs=0.06)
    assert not list(terrain_meshes(parts, frame, 0.0))


def test_no_rasters_are_made_where_none_are_wanted_or_points_have_no_class(tmp_path):
    assert rasterise_tile(sloping((0, 0)), RasterConfig(raster_resolution=0.0), DUTCH) is None
    assert rasterise_tile(PointTile(np.zeros((1, 3))), RasterConfig(), DUTCH) is None
    fragment = saved(tmp_path, sloping((0, 0)), RasterConfig(raster_resolution=0.0))
    assert write_rasters(tmp_path, [fragment], DUTCH, DUTCH.crs) == ({}, [])
    assert list(tmp_path.glob("*.tif")) == []


def test_the_files_lie_where_the_points_do_and_say_what_they_hold(tmp_path):
    told, _ = write_rasters(tmp_path, [saved(tmp_path, sloping((3.0, 4.0)))], DUTCH, DUTCH.crs)
    assert list(told) == list(RASTERS) == ["dtm.tif", "dsm.tif", "ndsm.tif"]
    for name in RASTERS:
        with rasterio.open(tmp_path / name) as file:
            assert file.bounds == (85_003.0, 447_004.0, 85_023.0, 447_024.0)
            assert file.res == (0.5, 0.5)
            assert file.crs.to_epsg() == 28992
            assert file.descriptions == (RASTERS[name],)
            values = file.read(1, masked=True)
            assert told[name] == {"width": 40, "height": 40, "cell": 0.5, "known_cells": values.count()}
            if name == "dtm.tif":
                column = np.arange(40) * 0.5 + 3.25
                np.testing.assert_allclose(values[20], 5.0 + 0.1 * column, atol=0.03)


def test_ndsm_is_dsm_minus_dtm_to_the_bit(tmp_path):
    write_rasters(tmp_path, [saved(tmp_path, sloping((3.0, 4.0)))], DUTCH, DUTCH.crs)
    dtm, dsm, ndsm = (rasterio.open(tmp_path / name).read(1, masked=True) for name in RASTERS)
    np.testing.assert_array_equal(ndsm, dsm - dtm)


def test_kriged_ground_has_its_variance_beside_it_in_squares_of_the_unit(tmp_path):
    frame, config = MapFrame("", (0.0, 0.0, 0.0), 0.3048, 0.3048), RasterConfig(dtm_interpolation="kriging")
    tile = sloping((0.0, 0.0), frame)
    told, _ = write_rasters(tmp_path, [saved(tmp_path, tile, config, frame)], frame, "")
    assert list(told) == [*RASTERS, "dtm_variance.tif"]
    with rasterio.open(tmp_path / "dtm_variance.tif") as file:
        assert file.units == ("foot^2",)
        values = file.read(1, masked=True)
    expected = rasterise_tile(tile, config, frame).dtm_variance
    np.testing.assert_allclose(values.filled(np.nan), expected / 0.3048**2, rtol=1e-5)
    assert told["dtm_variance.tif"]["known_cells"] == told["dtm.tif"]["known_cells"]


@pytest.mark.parametrize(("horizontal", "vertical"), [(SURVEY_FOOT, SURVEY_FOOT), (0.3048, 1.0)])
def test_a_source_in_feet_has_its_rasters_in_feet(tmp_path, horizontal, vertical):
    frame = MapFrame("", (600.0, 300.0, 0.0), horizontal, vertical)
    told, _ = write_rasters(
        tmp_path, [saved(tmp_path, sloping((0.0, 0.0), frame), None, frame)], frame, frame.crs
    )
    with rasterio.open(tmp_path / "dtm.tif") as file:
        assert file.crs is None
        assert file.res == pytest.approx((0.5 / horizontal, 0.5 / horizontal))
        assert told["dtm.tif"]["cell"] == pytest.approx(0.5 / horizontal)
        assert file.bounds.left == pytest.approx(600.0 / horizontal)
        assert file.units == (("US survey foot",) if vertical != 1.0 else ("metre",))
        assert file.read(1, masked=True).mean() == pytest.approx(6.0 / vertical, rel=0.01)


def test_the_order_of_tiles_and_their_coming_twice_change_nothing(tmp_path):
    cloud = cloud_files.saved(cloud_files.random_cloud(10), tmp_path / "a.laz")
    tiles = [sloping((20.0 * i, 20.0 * j), stamp=1_000 * (10 * i + j)) for i in range(4) for j in range(3)]
    contents = []
    for number in range(2):
        order = tiles * (number + 1)
        random.Random(number).shuffle(order)
        folder = OutputFolder(tmp_path / str(number), [InputFile(cloud, 10)], DUTCH, until="ground_filter")
        for tile in order:
            folder.write_tile(
                TileProducts.from_tiles(tile, rasters=rasterise_tile(tile, RasterConfig(), DUTCH))
            )
        summary = folder.finalise()
        assert summary.files[-4:] == (*RASTERS, "run.json")
        contents.append({name: (folder.path / name).read_bytes() for name in RASTERS})
    assert contents[0] == contents[1]
    told = json.loads((tmp_path / "0" / "run.json").read_text())
    size = told["rasters"]["dtm.tif"]
    assert (size["width"], size["height"], size["cell"]) == (160, 120, 0.5)
    assert size["known_cells"] > 0.94 * 160 * 120, (
        "these tiles have no buffers, and so some gaps between them"
    )


def test_the_tile_whose_core_is_nearest_has_a_cell_then_the_first(tmp_path):
    window = RasterWindow(1.0, 0, 0, 3, 1)
    nan = np.nan

    def tile(place, dtm, distance):
        values = np.array([dtm], dtype=np.float32)
        return TerrainRasters(place, values, values, np.array([distance], dtype=np.int32))

    whole = merged(
        window,
        iter(
            [
                tile(RasterWindow(1.0, 0, 0, 2, 1), [1.0, 1.0], [0, 4]),
                tile(RasterWindow(1.0, 0, 0, 3, 1), [2.0, 2.0, nan], [0, 1, 0]),
                tile(RasterWindow(1.0, 9, 9, 1, 1), [3.0], [0]),
            ]
        ),
    )
    np.testing.assert_array_equal(whole.dtm, [[1.0, 2.0, nan]])


def test_two_places_a_hundred_kilometres_apart_share_one_small_file(tmp_path):
    parts = [saved(tmp_path, sloping((d, d), size=19.9, stamp=k)) for k, d in ((1, 0.0), (2, 100_000.0))]
    told, _ = write_rasters(tmp_path, parts, DUTCH, DUTCH.crs)
    assert told["dtm.tif"]["width"] == told["dtm.tif"]["height"] == 200_040
    assert 3180 < told["dtm.tif"]["known_cells"] <= 3200
    for name in RASTERS:
        assert (tmp_path / name).stat().st_size < 8_000_000
        with rasterio.open(tmp_path / name) as file:
            for corner in ((0, 200_000), (200_000, 0)):
                found = file.read(1, window=rasterio.windows.Window(*corner, 40, 40), masked=True)
                assert found.count() > 1585
            assert (
                file.read(1, window=rasterio.windows.Window(99_000, 99_000, 40, 40), masked=True).count() == 0
            )


def test_places_too_far_apart_for_one_raster_leave_the_rest_of_the_run_complete(tmp_path):
    cloud = cloud_files.saved(cloud_files.random_cloud(10), tmp_path / "a.laz")
    folder = OutputFolder(tmp_path / "out", [InputFile(cloud, 10)], DUTCH, until="ground_filter")
    for k, d in ((1, 0.0), (2, 2_000_000.0)):
        tile = sloping((d, d), stamp=1_000 * k)
        rasters = rasterise_tile(tile, RasterConfig(), DUTCH)
        folder.write_tile(TileProducts.from_tiles(tile, rasters=rasters))
    summary = folder.finalise()
    (line,) = summary.problems
    assert line.startswith(f"{tmp_path / 'out'}: no rasters were made: 4,000,")
    assert "raise model_writer.raster_resolution" in line
    assert summary.files == ("classified/a.laz", "run.json")
    assert list((tmp_path / "out").glob("*.tif")) == []


def cloud_in(folder, crs=None, keys=None, name="a.laz"):
    cloud = cloud_files.random_cloud(20, point_format=6 if crs else 1)
    cloud = (
        cloud_files.with_wkt(cloud, pyproj.CRS(crs).to_wkt())
        if crs
        else cloud_files.with_geo_keys(cloud, keys)
    )
    opened = open_cloud(cloud_files.saved(cloud, folder / name))
    frame = MapFrame(opened.crs.name, (0.0, 0.0, 0.0), opened.crs.horizontal_unit, opened.crs.vertical_unit)
    return InputFile(opened.path, 20), frame


@pytest.mark.parametrize(
    ("given", "parts"),
    [
        ({"crs": "EPSG:7415"}, [28992, 5709]),
        ({"crs": "EPSG:2263+6360"}, [2263, 6360]),
        ({"crs": "EPSG:2263+5703"}, [2263, 5703]),
        ({"crs": "EPSG:28992"}, [28992]),
        ({"keys": {1024: 1, 3072: 28992, 4096: 5709}}, [28992, 5709]),
        ({"keys": {1024: 1, 3072: 28992}}, [28992]),
        # a code in metres with heights in feet fits neither
        ({"keys": {1024: 1, 3072: 2263, 4096: 5703, 4099: 9003}}, [2263]),
        # an ellipsoid, in the numbering of old
        ({"keys": {1024: 1, 3072: 28992, 4096: 5030}}, [28992]),
    ],
)
def test_the_vertical_system_that_a_file_states_joins_the_horizontal_one(tmp_path, given, parts):
    file, frame = cloud_in(tmp_path, **given)
    found = pyproj.CRS.from_user_input(crs_with_heights([file], frame))
    assert [part.to_epsg() for part in found.sub_crs_list or [found]] == parts


def test_vertical_systems_that_disagree_and_files_that_are_gone_leave_the_horizontal_one(tmp_path):
    one, frame = cloud_in(tmp_path, "EPSG:28992+5709", name="a.laz")
    other, _ = cloud_in(tmp_path, "EPSG:28992+5703", name="b.laz")
    assert crs_with_heights([one, other], frame) == "EPSG:28992"
    assert crs_with_heights([InputFile(Path("gone.laz"), 1)], frame) == "EPSG:28992"
    assert crs_with_heights([one], MapFrame()) == ""
