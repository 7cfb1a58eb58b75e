"""Cutting clouds into tiles: every point once, buffers as brute force finds them, seams."""

import laspy
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support import cloud_files
from support.cut_surveys import (
    SOUTH,
    WEST,
    all_names,
    core_names,
    names,
    square,
    survey,
    tiles_of,
    two_neighbours,
)

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.io.tiling.tiling import TileSource, TilingConfig


@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(tile_size=st.floats(20.0, 400.0), buffer=st.floats(0.0, 120.0))
def test_every_point_is_a_core_point_once(tmp_path, tile_size, buffer):
    paths = two_neighbours(tmp_path)
    with TileSource(paths, TilingConfig(tile_size=tile_size, buffer=buffer, max_buffer=buffer)) as source:
        tiles = list(tiles_of(source))
        assert sorted(core_names(tiles)) == all_names(source)
        assert len(tiles) == source.tile_count
        assert len({tile.stamp for tile in tiles}) == len(tiles)


@pytest.mark.parametrize(("tile_size", "buffer"), [(60.0, 20.0), (30.0, 45.0), (250.0, 0.0), (25.0, 25.0)])
def test_core_and_buffer_are_what_brute_force_finds(tmp_path, tile_size, buffer):
    paths = two_neighbours(tmp_path)
    with TileSource(paths, TilingConfig(tile_size=tile_size, buffer=buffer, max_buffer=200.0)) as source:
        xy = np.concatenate([np.asarray(laspy.read(path).xyz)[:, :2] for path in paths])
        name = np.array(all_names(source))
        for tile in tiles_of(source):
            x0, y0 = (
                np.floor((tile.frame.to_source(tile.points)[tile.is_core][0, :2]) / tile_size) * tile_size
            )
            x, y = xy.T
            core = (x >= x0) & (x < x0 + tile_size) & (y >= y0) & (y < y0 + tile_size)
            less, least = buffer * 2.0 / 3.0, buffer / 3.0
            wide = (x >= x0 - least) & (x <= x0 + tile_size + buffer)
            wide &= (y >= y0 - less) & (y <= y0 + tile_size + less)
            assert names(tile) == [tuple(n) for n in name[wide].tolist()], "rows by (source, index)"
            assert names(tile, tile.is_core) == [tuple(n) for n in name[core & wide].tolist()]
            west, south, east, _ = tile.bounds
            assert (west, south) == pytest.approx((x0 - least - tile.frame.origin[0], y0 - less - SOUTH))
            assert east == pytest.approx(x0 + tile_size + buffer - tile.frame.origin[0])


def test_tiles_lie_on_multiples_of_their_size_whatever_the_files(tmp_path):
    paths = two_neighbours(tmp_path)
    config = TilingConfig(tile_size=40.0, buffer=15.0, max_buffer=15.0)
    with TileSource(paths, config) as both, TileSource(paths[1], config) as second:
        assert both.frame.origin[:2] == (WEST, SOUTH)
        squares = [
            {tuple(np.add(t.bounds[:2], t.frame.origin[:2])) for t in tiles_of(source)}
            for source in (both, second)
        ]
        assert squares[1] < squares[0]
        assert all((x + 5.0) % 40.0 == 0 and (y + 10.0) % 40.0 == 0 for x, y in squares[0])


def test_without_a_size_the_tiles_hold_about_as_many_points_as_asked_for(tmp_path):
    paths = survey(tmp_path, [square(4000, 110.0, 110.0, 180.0), square(4000, 290.0, 110.0, 180.0, seed=1)])
    config = TilingConfig(buffer=10.0, max_buffer=10.0, max_tile_points=3000)
    with TileSource(paths, config) as source:
        tiles = list(tiles_of(source))
        assert sorted(core_names(tiles)) == all_names(source)
    assert max(len(tile) for tile in tiles) <= 3300
    assert sum(len(tile) for tile in tiles) <= 1.5 * 8000


def test_a_tile_that_is_much_denser_than_its_file_is_divided(tmp_path):
    corner = square(5000, 100.0, 100.0, 200.0)
    paths = survey(tmp_path, [np.vstack([corner, [[900.0, 900.0]]])])
    config = TilingConfig(buffer=5.0, max_buffer=5.0, max_tile_points=2000)
    with TileSource(paths, config) as source:
        tiles = list(tiles_of(source))
        assert sorted(core_names(tiles)) == all_names(source)
    assert max(np.count_nonzero(tile.is_core) for tile in tiles) <= 2500
    for tile in tiles:
        west, south, east, north = tile.bounds
        x, y, _ = tile.points.T
        assert x.min() >= west
        assert y.min() >= south
        assert x.max() <= east
        assert y.max() <= north


def test_columns_are_the_files_own(tmp_path):
    paths = survey(tmp_path, [square(300, WEST, SOUTH, 60.0)], point_format=6, ending=".laz")
    whole = laspy.read(paths[0])
    classes = np.where(whole.withheld, 7, whole.classification)
    with TileSource(paths, TilingConfig(tile_size=30.0)) as source:
        for tile in tiles_of(source):
            assert np.array_equal(tile.classification, classes[tile.index])
            for name in ("intensity", "return_number", "number_of_returns", "gps_time"):
                assert np.array_equal(getattr(tile, name), np.asarray(whole[name])[tile.index]), name
            assert np.allclose(
                tile.frame.to_source(tile.points), np.asarray(whole.xyz)[tile.index], atol=1e-4
            )


def test_a_file_without_times_takes_them_from_the_whole_tile(tmp_path):
    first, second = [square(50, WEST, SOUTH, 20.0, seed) for seed in (0, 1)]
    timed = survey(tmp_path, [first], point_format=1)
    (tmp_path / "more").mkdir()
    untimed = survey(tmp_path / "more", [second], point_format=0)
    with TileSource([*timed, *untimed]) as source:
        (tile,) = tiles_of(source)
    assert tile.gps_time is None


def test_points_outside_their_headers_bounds_are_not_lost(tmp_path):
    paths = survey(tmp_path, [square(300, WEST, SOUTH, 100.0, 1), square(300, WEST + 100.0, SOUTH, 100.0, 2)])
    stray = laspy.read(paths[1])
    stray.x[-3:], stray.y[-3:] = [WEST + 10.0, WEST + 11.0, WEST - 500.0], [SOUTH + 5.0, SOUTH + 6.0, SOUTH]
    honest = paths[1].read_bytes()[179:227]
    cloud_files.patched(cloud_files.saved(stray, paths[1]), 179, honest)
    with TileSource(paths, TilingConfig(tile_size=25.0, buffer=5.0, max_buffer=10.0)) as source:
        tiles = list(tiles_of(source))
        assert sorted(core_names(tiles)) == all_names(source)
        assert len({tile.stamp for tile in tiles}) == len(tiles)


def test_a_single_point_far_away_is_a_tile_of_its_own(tmp_path):
    xy = np.vstack([square(50, WEST, SOUTH, 50.0), [[WEST + 900_000.0, SOUTH]]])
    with TileSource(survey(tmp_path, [xy])) as source:
        tiles = list(tiles_of(source))
        assert sorted(core_names(tiles)) == all_names(source)
        assert min(len(tile) for tile in tiles) == 1


def test_feet_are_cut_in_metres(tmp_path):
    cloud = cloud_files.random_cloud(
        500, point_format=6, corner=(983000.0, 199000.0, 30.0), size=(400.0, 10.0, 30.0)
    )
    path = cloud_files.saved(cloud_files.with_wkt(cloud, "EPSG:2263"), tmp_path / "feet.laz")
    with TileSource(path, TilingConfig(tile_size=50.0, buffer=0.0, max_buffer=0.0)) as source:
        tiles = list(tiles_of(source))
        assert sorted(core_names(tiles)) == all_names(source)
        assert len(tiles) == 3, "400 US survey feet are 122 m, and begin within a tile"
        assert all(np.ptp(tile.points[:, 0]) <= 50.0 for tile in tiles)


def test_no_point_gives_no_tile(tmp_path):
    with TileSource(survey(tmp_path, [np.empty((0, 2))])) as source:
        assert list(tiles_of(source)) == []
        assert source.tile_count == 0


def test_buffers_out_of_range_are_refused():
    with pytest.raises(
        ParameterError, match=r"tile_player\.tile_size = 1\.0: must be 0 or within 10 to 10000 \[m\]"
    ):
        TilingConfig(tile_size=1.0)


@pytest.mark.real_data
def test_the_delft_tiles_come_out_once_across_their_seam(data_folder):
    with TileSource(data_folder / "delft", TilingConfig(tile_size=250.0, buffer=50.0)) as source:
        tiles = list(tiles_of(source))
        assert sum(int(tile.is_core.sum()) for tile in tiles) == 848_942
        assert all(len(set(names(tile))) == len(tile) for tile in tiles)
        west_of_seam = [t for t in tiles if t.is_core.any() and t.bounds[2] + t.frame.origin[0] == 85_050.0]
        assert all((t.source == 1).any() for t in west_of_seam)
        assert west_of_seam
