"""GeoTIFF files: what they say of themselves, blocks in any number, and a disk that is full."""

import subprocess
import sys

import numpy as np
import pyproj
import pytest
import rasterio

from lidar_buildings import __version__
from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.io.results.terrain_files import BLOCK, NODATA, GeotiffWriter, RasterLayout

DUTCH = "EPSG:28992"


def layout(width=300, height=200, crs=DUTCH, unit="metre", cell=0.5):
    return RasterLayout(width, height, 84_808.0, 447_641.5, cell, crs, unit)


def hills(height, width, seed=0):
    values = np.random.default_rng(seed).normal(10.0, 2.0, (height, width)).astype(np.float32)
    values[values < 8.0] = np.nan
    return values


def written(path, values, plan):
    with GeotiffWriter(path, plan, "elevation of the ground") as file:
        for row in range(0, plan.height, BLOCK):
            for column in range(0, plan.width, BLOCK):
                file.write(row, column, values[row : row + BLOCK, column : column + BLOCK])
    return path


@pytest.mark.parametrize(("width", "height"), [(1, 1), (300, 200), (512, 512), (1300, 700)])
def test_a_file_gives_back_every_value_and_says_where_they_lie(tmp_path, width, height):
    values = hills(height, width)
    path = written(tmp_path / "dtm.tif", values, layout(width, height))
    with rasterio.open(path) as file:
        assert (file.width, file.height, file.count, file.dtypes) == (width, height, 1, ("float32",))
        assert file.nodata == NODATA
        assert file.transform == rasterio.Affine(0.5, 0.0, 84_808.0, 0.0, -0.5, 447_641.5)
        assert file.crs == rasterio.CRS.from_epsg(28992)
        assert file.units == ("metre",)
        assert file.descriptions == ("elevation of the ground",)
        assert file.tags()["TIFFTAG_SOFTWARE"] == f"lidar_buildings {__version__}"
        assert file.tags()["AREA_OR_POINT"] == "Area"
        assert file.compression.name == "deflate"
        assert file.block_shapes == [(BLOCK, BLOCK)]
        found = file.read(1, masked=True)
    np.testing.assert_array_equal(found.filled(np.nan), values)


def test_large_rasters_have_overviews_and_small_ones_need_none(tmp_path):
    with rasterio.open(written(tmp_path / "a.tif", hills(1100, 2100), layout(2100, 1100))) as file:
        assert file.overviews(1) == [2, 4, 8]
    with rasterio.open(tmp_path / "a.tif", OVERVIEW_LEVEL=2) as coarse:
        assert coarse.shape == (137, 262)
        assert coarse.read(1, masked=True).mean() == pytest.approx(10.5, abs=0.5)
    with rasterio.open(written(tmp_path / "b.tif", hills(512, 512), layout(512, 512))) as file:
        assert file.overviews(1) == []


def test_large_rasters_are_cloud_optimised_coarse_overviews_come_first(tmp_path):
    with rasterio.open(written(tmp_path / "a.tif", hills(1100, 2100), layout(2100, 1100))) as file:
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        levels = [{"ovr": level} for level in (2, 1, 0)] + [{}]
        offsets = [int(file.get_tag_item("BLOCK_OFFSET_0_0", "TIFF", bidx=1, **level)) for level in levels]
    assert offsets == sorted(offsets)
    assert [file.name for file in tmp_path.iterdir()] == ["a.tif"]


def test_equal_content_gives_equal_bytes(tmp_path):
    values = hills(700, 1300)
    one, other = (written(tmp_path / n, values, layout(1300, 700)) for n in ("a.tif", "b.tif"))
    assert one.read_bytes() == other.read_bytes()


@pytest.mark.parametrize(
    ("crs", "vertical"),
    [
        ("EPSG:2154+5720", "NGF-IGN69"),
        ("EPSG:7415", "NAP"),
        ("EPSG:2263+6360", "NAVD88"),
        (DUTCH, ""),
        ("", ""),
    ],
)
def test_the_vertical_system_is_kept_with_the_horizontal_one(tmp_path, crs, vertical):
    text = pyproj.CRS(crs).to_wkt() if crs else ""
    with rasterio.open(written(tmp_path / "a.tif", hills(5, 5), layout(5, 5, text))) as file:
        if not crs:
            assert file.crs is None
            return
        found = pyproj.CRS.from_wkt(file.crs.to_wkt())
    expected = pyproj.CRS(crs)
    horizontal = expected.sub_crs_list[0] if vertical else expected
    assert (found.sub_crs_list[0] if vertical else found).to_epsg() == horizontal.to_epsg()
    assert found.is_compound == bool(vertical)
    assert vertical in found.name


def test_blocks_that_are_not_written_hold_nothing_and_take_no_room(tmp_path):
    plan = layout(200_000, 200_000)
    values = hills(100, 100)
    with GeotiffWriter(tmp_path / "a.tif", plan, "elevation of the ground") as file:
        file.write(0, 0, values)
        file.write(BLOCK * 200, BLOCK * 200, np.full((BLOCK, BLOCK), np.nan, dtype=np.float32))
        file.write(BLOCK * 300, BLOCK * 300, values)
    assert (tmp_path / "a.tif").stat().st_size < 8_000_000
    with rasterio.open(tmp_path / "a.tif") as file:
        last = rasterio.windows.Window(BLOCK * 300, BLOCK * 300, 100, 100)
        np.testing.assert_array_equal(file.read(1, window=last, masked=True).filled(np.nan), values)
        between = rasterio.windows.Window(BLOCK * 200, BLOCK * 200, 100, 100)
        assert (file.read(1, window=between) == NODATA).all()
        assert file.overviews(1) == [], "they would have GDAL visit 150,000 empty blocks"


def test_a_raster_without_any_value_is_legal(tmp_path):
    with rasterio.open(written(tmp_path / "a.tif", np.full((40, 40), np.nan, "f4"), layout(40, 40))) as file:
        assert (file.read(1) == NODATA).all()


def test_a_folder_that_is_not_there_gives_one_line(tmp_path, caplog):
    with pytest.raises(OutputError, match=r"nowhere/a\.tif: cannot be written") as caught:
        written(tmp_path / "nowhere" / "a.tif", hills(5, 5), layout(5, 5))
    assert "\n" not in str(caught.value)
    assert caplog.messages == []


def test_an_error_of_the_caller_s_is_not_hidden_by_one_of_the_file_s(tmp_path):
    with (
        pytest.raises(ZeroDivisionError),
        GeotiffWriter(tmp_path / "a.tif", layout(), "elevation of the ground"),
    ):
        raise ZeroDivisionError


_LIMITED = """
import resource
import signal
import sys
from pathlib import Path
import numpy as np
from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.io.results.terrain_files import BLOCK, GeotiffWriter, RasterLayout
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
values = np.random.default_rng(0).random((BLOCK, BLOCK)).astype("f4")
layout = RasterLayout(4 * BLOCK, BLOCK, 0.0, 9.0, 2.0, "", "metre")
try:
    with GeotiffWriter(Path(sys.argv[1]), layout, "x") as file:
        for column in range(4):
            file.write(0, column * BLOCK, values)
except OutputError as error:
    print(error)
"""


def test_a_full_disk_gives_one_line(tmp_path):
    path = tmp_path / "a.tif"
    done = subprocess.run([sys.executable, "-c", _LIMITED, str(path)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    (line,) = done.stdout.splitlines()
    assert line.startswith(f"{path}: cannot be written (")
    assert "free some space" in line
