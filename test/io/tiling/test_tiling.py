"""Cutting clouds into tiles: every point once, buffers as brute force finds them, seams, stamps, growth."""

import gc
import pickle
import threading
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import laspy
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support import cloud_files
from support.long_survey import peak_of_surveys

from lidar_buildings.core.model.errors import InputError, OutputError, ParameterError
from lidar_buildings.core.model.sides import Sides
from lidar_buildings.io.clouds.cloud import Cloud
from lidar_buildings.io.tiling.spool import RECORD, Spool
from lidar_buildings.io.tiling.tiling import TileSource, TilingConfig

WEST, SOUTH = 84900.0, 447000.0


def survey(tmp_path, xy_of_files, *, ending=".las", **options):
    """Write one file per array of plan coordinates."""
    paths = []
    for number, xy in enumerate(xy_of_files):
        cloud = cloud_files.random_cloud(len(xy), seed=number, **options)
        cloud.x, cloud.y = xy[:, 0], xy[:, 1]
        paths.append(cloud_files.saved(cloud, tmp_path / f"part_{number}{ending}"))
    return paths


def square(n_points, west, south, size, seed=0):
    return (
        np.random.default_rng(seed)
        .uniform([west, south], [west + size, south + size], (n_points, 2))
        .round(3)
    )


def two_neighbours(tmp_path, n_points=400):
    return survey(
        tmp_path, [square(n_points, WEST, SOUTH, 100.0, 1), square(n_points, WEST + 100.0, SOUTH, 100.0, 2)]
    )


def names(tile, rows=slice(None)):
    return list(zip(tile.source[rows].tolist(), tile.index[rows].tolist(), strict=True))


def core_names(tiles):
    return [name for tile in tiles for name in names(tile, tile.is_core)]


def all_names(source):
    return [(number, index) for number, file in enumerate(source.inputs) for index in range(file.point_count)]


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(tile_size=st.floats(20.0, 400.0), buffer=st.floats(0.0, 120.0))
def test_every_point_is_a_core_point_once(tmp_path, tile_size, buffer):
    paths = two_neighbours(tmp_path)
    with TileSource(paths, TilingConfig(tile_size=tile_size, buffer=buffer, max_buffer=buffer)) as source:
        tiles = list(source)
        assert sorted(core_names(tiles)) == all_names(source)
        assert len(tiles) == source.tile_count
        assert len({tile.stamp for tile in tiles}) == len(tiles)


@pytest.mark.parametrize(("tile_size", "buffer"), [(60.0, 20.0), (30.0, 45.0), (250.0, 0.0), (25.0, 25.0)])
def test_core_and_buffer_are_what_brute_force_finds(tmp_path, tile_size, buffer):
    paths = two_neighbours(tmp_path)
    with TileSource(paths, TilingConfig(tile_size=tile_size, buffer=buffer, max_buffer=200.0)) as source:
        xy = np.concatenate([np.asarray(laspy.read(path).xyz)[:, :2] for path in paths])
        name = np.array(all_names(source))
        for tile in source:
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
            {tuple(np.add(t.bounds[:2], t.frame.origin[:2])) for t in source} for source in (both, second)
        ]
        assert squares[1] < squares[0]
        assert all((x + 5.0) % 40.0 == 0 and (y + 10.0) % 40.0 == 0 for x, y in squares[0])


def test_without_a_size_the_tiles_hold_about_as_many_points_as_asked_for(tmp_path):
    paths = survey(tmp_path, [square(4000, 110.0, 110.0, 180.0), square(4000, 290.0, 110.0, 180.0, seed=1)])
    config = TilingConfig(buffer=10.0, max_buffer=10.0, max_tile_points=3000)
    with TileSource(paths, config) as source:
        tiles = list(source)
        assert sorted(core_names(tiles)) == all_names(source)
    assert max(len(tile) for tile in tiles) <= 3300
    assert sum(len(tile) for tile in tiles) <= 1.5 * 8000


def test_a_survey_that_fits_into_a_tile_is_one_where_its_place_allows(tmp_path):
    paths = survey(tmp_path, [square(400, 980.0, 480.0, 40.0)])
    with TileSource(paths) as source:
        assert len(list(source)) == 1


def test_a_tile_that_is_much_denser_than_its_file_is_divided(tmp_path):
    corner = square(5000, 100.0, 100.0, 200.0)
    paths = survey(tmp_path, [np.vstack([corner, [[900.0, 900.0]]])])
    config = TilingConfig(buffer=5.0, max_buffer=5.0, max_tile_points=2000)
    with TileSource(paths, config) as source:
        tiles = list(source)
        assert sorted(core_names(tiles)) == all_names(source)
    assert max(np.count_nonzero(tile.is_core) for tile in tiles) <= 2500
    for tile in tiles:
        west, south, east, north = tile.bounds
        x, y, _ = tile.points.T
        assert x.min() >= west
        assert y.min() >= south
        assert x.max() <= east
        assert y.max() <= north


def test_the_map_frame_does_not_depend_on_the_tile_size(tmp_path):
    paths = two_neighbours(tmp_path)
    frames = set()
    for tile_size in (20.0, 250.0):
        with TileSource(paths, TilingConfig(tile_size=tile_size)) as source:
            frames.add(source.frame)
    assert len(frames) == 1


def test_columns_are_the_files_own(tmp_path):
    paths = survey(tmp_path, [square(300, WEST, SOUTH, 60.0)], point_format=6, ending=".laz")
    whole = laspy.read(paths[0])
    classes = np.where(whole.withheld, 7, whole.classification)
    with TileSource(paths, TilingConfig(tile_size=30.0)) as source:
        for tile in source:
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
        (tile,) = source
    assert tile.gps_time is None


def test_a_building_across_the_seam_of_two_files_is_whole_in_a_tile(tmp_path):
    house = square(200, WEST + 90.0, SOUTH + 40.0, 20.0, 3)
    left, right = house[house[:, 0] < WEST + 100.0], house[house[:, 0] >= WEST + 100.0]
    with TileSource(survey(tmp_path, [left, right]), TilingConfig(tile_size=100.0, buffer=30.0)) as source:
        assert max(len(tile) for tile in source) == 200


def test_files_that_overlap_keep_both_their_points(tmp_path):
    paths = survey(tmp_path, [square(100, WEST, SOUTH, 50.0, 1), square(100, WEST + 20.0, SOUTH, 50.0, 2)])
    with TileSource(paths) as source:
        assert sorted(core_names(source)) == all_names(source)


def test_tiles_come_before_the_whole_folder_is_read(tmp_path, monkeypatch):
    paths = survey(tmp_path, [square(50, WEST + 100.0 * k, SOUTH, 100.0, k) for k in range(6)])
    read = []
    plain = Cloud.chunks
    monkeypatch.setattr(Cloud, "chunks", lambda self, size: (read.append(self.path), plain(self, size))[1])
    with TileSource(paths, TilingConfig(tile_size=50.0, buffer=10.0, max_buffer=20.0)) as source:
        next(iter(source))
        assert 0 < len(read) <= 3


def test_a_tile_waits_for_every_file_that_its_largest_buffer_may_need(tmp_path):
    paths = survey(tmp_path, [square(80, WEST + 100.0 * k, SOUTH, 100.0, k) for k in range(4)])
    config = TilingConfig(tile_size=50.0, buffer=10.0, max_buffer=80.0)
    with TileSource(paths, config) as source, TileSource(paths, config) as patient:
        list(patient)
        for tile in source:
            for early, late in zip(grown_fully(source, tile), grown_fully(patient, tile), strict=True):
                assert names(early) == names(late)


def grown_fully(source, tile):
    steps = []
    while (tile := source.grown(tile.stamp)) is not None:
        steps.append(tile)
    return steps


def test_points_outside_their_headers_bounds_are_not_lost(tmp_path):
    paths = survey(tmp_path, [square(300, WEST, SOUTH, 100.0, 1), square(300, WEST + 100.0, SOUTH, 100.0, 2)])
    stray = laspy.read(paths[1])
    stray.x[-3:], stray.y[-3:] = [WEST + 10.0, WEST + 11.0, WEST - 500.0], [SOUTH + 5.0, SOUTH + 6.0, SOUTH]
    honest = paths[1].read_bytes()[179:227]
    cloud_files.patched(cloud_files.saved(stray, paths[1]), 179, honest)
    with TileSource(paths, TilingConfig(tile_size=25.0, buffer=5.0, max_buffer=10.0)) as source:
        tiles = list(source)
        assert sorted(core_names(tiles)) == all_names(source)
        assert len({tile.stamp for tile in tiles}) == len(tiles)


def test_a_single_point_far_away_is_a_tile_of_its_own(tmp_path):
    xy = np.vstack([square(50, WEST, SOUTH, 50.0), [[WEST + 2_000_000.0, SOUTH]]])
    with TileSource(survey(tmp_path, [xy])) as source:
        tiles = list(source)
        assert sorted(core_names(tiles)) == all_names(source)
        assert min(len(tile) for tile in tiles) == 1


def test_growing_doubles_the_buffer_until_its_cap(tmp_path):
    paths = survey(tmp_path, [square(4000, WEST, SOUTH, 400.0)])
    with TileSource(paths, TilingConfig(tile_size=50.0, buffer=10.0, max_buffer=30.0)) as source:
        tile = max(source, key=len)
        east = tile.bounds[2]
        grown = grown_fully(source, tile)
        assert [larger.bounds[2] - east for larger in grown] == pytest.approx([10.0, 20.0])
        assert {larger.stamp for larger in grown} == {tile.stamp}
        assert all(names(larger, larger.is_core) == names(tile, tile.is_core) for larger in grown)
        assert source.grown(tile.stamp) is None


def test_a_tile_grows_on_the_sides_that_are_asked_for(tmp_path):
    paths = survey(tmp_path, [square(4000, WEST, SOUTH, 400.0)])
    with TileSource(paths, TilingConfig(tile_size=50.0, buffer=12.0, max_buffer=30.0)) as source:
        tile = max(source, key=len)
        north = source.grown(tile.stamp, Sides(north=True))
        both = source.grown(tile.stamp, Sides(east=True, north=True))
        assert np.subtract(north.bounds, tile.bounds) == pytest.approx([0.0, 0.0, 0.0, 8.0])
        assert np.subtract(both.bounds, tile.bounds) == pytest.approx([0.0, 0.0, 12.0, 12.0])
        assert set(names(tile)) < set(names(north)) < set(names(both))
        assert source.grown(tile.stamp, Sides(north=True)) is None


def test_a_tile_that_was_sent_elsewhere_is_the_same_there(tmp_path):
    paths = survey(tmp_path, [square(4000, WEST, SOUTH, 400.0)])
    with TileSource(paths, TilingConfig(tile_size=50.0, buffer=10.0, max_buffer=30.0)) as source:
        sent = [pickle.loads(pickle.dumps(tile)) for tile in source.ready()]
        for here, there in zip(source, sent, strict=True):
            assert names(here) == names(there.read())
            assert here.point_spacing == there.read().point_spacing
            assert there.grow()
            assert names(source.grown(here.stamp)) == names(there.read())


def test_growing_ends_where_there_are_no_more_points(tmp_path):
    with TileSource(survey(tmp_path, [square(50, WEST, SOUTH, 40.0)])) as source:
        (tile,) = source
        assert source.grown(tile.stamp) is None


def test_growing_an_unknown_tile_is_a_mistake(tmp_path):
    with (
        TileSource(two_neighbours(tmp_path)) as source,
        pytest.raises(ValueError, match="stamp = 5: must be"),
    ):
        source.grown(5)


def test_the_stamp_is_the_first_core_points_time(tmp_path):
    paths = survey(tmp_path, [square(300, WEST, SOUTH, 100.0)], point_format=1)
    cloud = laspy.read(paths[0])
    cloud.header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    cloud_files.saved(cloud, paths[0])
    with TileSource(paths, TilingConfig(tile_size=50.0)) as source:
        for tile in source:
            gps = float(tile.gps_time[tile.is_core][0])
            assert tile.stamp == round((gps + 1e9 + 315_964_800 - 18) * 1e6) * 1000


def test_tiles_of_one_time_get_stamps_of_their_own(tmp_path):
    paths = survey(tmp_path, [square(300, WEST, SOUTH, 100.0)])
    cloud = laspy.read(paths[0])
    cloud.gps_time[:] = 1000.0
    cloud_files.saved(cloud, paths[0])
    with TileSource(paths, TilingConfig(tile_size=50.0)) as source:
        stamps = [tile.stamp for tile in source]
    assert stamps == [1000 * 10**9 + 1000 * nudge for nudge in range(4)]


def test_without_times_stamps_are_the_tiles_numbers(tmp_path):
    paths = survey(tmp_path, [square(300, WEST, SOUTH, 100.0)], point_format=0)
    with TileSource(paths, TilingConfig(tile_size=50.0)) as source:
        assert sorted(tile.stamp for tile in source) == [n * 10**9 for n in (1, 2, 3, 4)]


def test_two_runs_give_the_same_tiles_with_the_same_stamps(tmp_path):
    paths = two_neighbours(tmp_path)
    config = TilingConfig(tile_size=30.0)
    with TileSource(paths, config) as one, TileSource(paths, config) as other:
        for mine, theirs in zip(one, other, strict=True):
            assert mine.stamp == theirs.stamp
            assert np.array_equal(mine.points, theirs.points)
            assert names(mine) == names(theirs)


def test_tiles_that_are_done_are_skipped(tmp_path):
    paths = two_neighbours(tmp_path)
    config = TilingConfig(tile_size=50.0)
    with TileSource(paths, config) as source:
        stamps = [tile.stamp for tile in source]
    with TileSource(paths, config, skip=set(stamps[::2])) as source:
        assert [tile.stamp for tile in source] == stamps[1::2]
        assert source.tile_count == len(stamps)


def test_iterating_again_starts_again(tmp_path):
    with TileSource(two_neighbours(tmp_path), TilingConfig(tile_size=50.0)) as source:
        first = [(tile.stamp, len(tile)) for tile in source]
        assert [(tile.stamp, len(tile)) for tile in source] == first


def test_the_number_of_tiles_is_known_early(tmp_path):
    with TileSource(two_neighbours(tmp_path), TilingConfig(tile_size=50.0)) as source:
        expected = source.tile_count
        assert len(list(source)) == 8 <= expected <= 15


def test_feet_are_cut_in_metres(tmp_path):
    cloud = cloud_files.random_cloud(
        500, point_format=6, corner=(983000.0, 199000.0, 30.0), size=(400.0, 10.0, 30.0)
    )
    path = cloud_files.saved(cloud_files.with_wkt(cloud, "EPSG:2263"), tmp_path / "feet.laz")
    with TileSource(path, TilingConfig(tile_size=50.0, buffer=0.0, max_buffer=0.0)) as source:
        tiles = list(source)
        assert sorted(core_names(tiles)) == all_names(source)
        assert len(tiles) == 3, "400 US survey feet are 122 m, and begin within a tile"
        assert all(np.ptp(tile.points[:, 0]) <= 50.0 for tile in tiles)


def test_no_point_gives_no_tile(tmp_path):
    with TileSource(survey(tmp_path, [np.empty((0, 2))])) as source:
        assert list(source) == []
        assert source.tile_count == 0


def test_one_point_gives_one_tile(tmp_path):
    with TileSource(survey(tmp_path, [np.array([[WEST, SOUTH]])])) as source:
        (tile,) = source
    assert len(tile) == 1


def test_an_unreadable_file_is_reported_and_the_rest_done(tmp_path):
    paths = two_neighbours(tmp_path)
    (tmp_path / "bad.laz").write_bytes(b"no cloud")
    with TileSource([tmp_path / "bad.laz", *paths]) as source:
        assert [file.path for file in source.inputs] == paths
        assert sorted(core_names(source)) == all_names(source)
        assert len(source.problems) == 1
        assert "bad.laz" in source.problems[0]


def failing_after_the_first_chunk(monkeypatch, name):
    plain = Cloud.chunks

    def chunks(self, size):
        yield from ([next(plain(self, 50))] if self.path.stem == name else plain(self, size))
        if self.path.stem == name:
            raise InputError(f"{self.path}: is damaged: copy it again")

    monkeypatch.setattr(Cloud, "chunks", chunks)


def test_a_file_that_fails_half_way_leaves_none_of_its_points(tmp_path, monkeypatch):
    failing_after_the_first_chunk(monkeypatch, "part_1")
    with TileSource(two_neighbours(tmp_path), TilingConfig(tile_size=30.0)) as source:
        assert sorted(core_names(source)) == [(0, index) for index in range(400)]
        assert "part_1" in source.problems[0]


def test_a_single_file_that_fails_half_way_is_an_error(tmp_path, monkeypatch):
    failing_after_the_first_chunk(monkeypatch, "part_0")
    with (
        TileSource(survey(tmp_path, [square(100, WEST, SOUTH, 100.0)])) as source,
        pytest.raises(InputError, match=r"part_0\.las"),
    ):
        list(source)


def test_a_full_disk_gives_one_line(tmp_path, monkeypatch):
    paths = two_neighbours(tmp_path)

    def full(*_):
        raise OSError(28, "No space left on device")

    with TileSource(paths) as source:
        monkeypatch.setattr(
            "builtins.open",
            lambda name, mode="r", *a, **k: full() if "a" in mode else PLAIN_OPEN(name, mode, *a, **k),
        )
        with pytest.raises(OutputError, match=r"No space left on device\): free some space"):
            list(source)


PLAIN_OPEN = open


def test_a_missing_temporary_folder_gives_one_line(tmp_path):
    with pytest.raises(OutputError, match="nowhere"):
        TileSource(two_neighbours(tmp_path), temporary=tmp_path / "nowhere")


def test_closing_removes_the_temporary_folder_and_ends_the_iteration(tmp_path):
    (tmp_path / "spool").mkdir()
    source = TileSource(two_neighbours(tmp_path), TilingConfig(tile_size=20.0), temporary=tmp_path / "spool")
    seen, started = [], threading.Event()

    def work():
        for tile in source:
            seen.append(tile)
            started.set()
            if len(seen) == 3:
                resume.wait(10.0)

    resume = threading.Event()
    worker = threading.Thread(target=work)
    worker.start()
    assert started.wait(10.0)
    source.close()
    resume.set()
    worker.join(10.0)
    assert not worker.is_alive()
    assert 1 <= len(seen) <= 4
    assert list((tmp_path / "spool").iterdir()) == []
    assert list(source) == []


def test_the_temporary_folder_goes_with_the_source(tmp_path):
    (tmp_path / "spool").mkdir()
    source = TileSource(two_neighbours(tmp_path), temporary=tmp_path / "spool")
    next(iter(source))
    del source
    gc.collect()
    assert list((tmp_path / "spool").iterdir()) == []


def test_memory_holds_a_chunk_and_a_tile_whatever_the_size():
    # In a process of its own, where nothing else takes memory. What the first tiles load does not count.
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as own_process:
        n_points, peak = own_process.submit(peak_of_surveys, 2, 40).result()
    assert n_points == 40 * 25_000
    everything = n_points * RECORD.itemsize
    assert peak < everything / 4, f"{peak / 1e6:.0f} MB in memory for {everything / 1e6:.0f} MB of points"


def test_buffers_out_of_range_are_refused():
    with pytest.raises(
        ParameterError, match=r"tile_player\.tile_size = 1\.0: must be 0 or within 10 to 10000 \[m\]"
    ):
        TilingConfig(tile_size=1.0)


def test_the_spool_gives_back_what_it_took_in_order(tmp_path):
    spool = Spool(tmp_path)
    random = np.random.default_rng(0)
    cells = random.integers(-40_000, 40_000, (3, 200, 2)) // 20_000
    records = np.zeros((3, 200), RECORD)
    records["index"] = np.arange(600).reshape(3, 200)
    for step in range(3):
        spool.append(cells[step], records[step])
    flat = cells.reshape(-1, 2)
    for cell in {tuple(c) for c in flat.tolist()}:
        found = np.concatenate(list(spool.blocks(cell)))["index"]
        assert found.tolist() == np.flatnonzero((flat == cell).all(axis=1)).tolist()
        assert spool.count(cell) == len(found)
    spool.remove()
    assert list(tmp_path.iterdir()) == []


def test_far_apart_cells_are_grouped_as_well(tmp_path):
    spool = Spool(tmp_path)
    cells = np.array([[0, 0], [10**9, -(10**9)], [0, 0]])
    records = np.zeros(3, RECORD)
    records["index"] = [1, 2, 3]
    assert sorted(spool.append(cells, records)) == [(0, 0), (10**9, -(10**9))]
    assert [r["index"].tolist() for r in spool.blocks((0, 0))] == [[1, 3]]


@pytest.mark.real_data
def test_the_delft_tiles_come_out_once_across_their_seam(data_folder):
    with TileSource(data_folder / "delft", TilingConfig(tile_size=250.0, buffer=50.0)) as source:
        tiles = list(source)
        assert sum(int(tile.is_core.sum()) for tile in tiles) == 848_942
        assert all(len(set(names(tile))) == len(tile) for tile in tiles)
        west_of_seam = [t for t in tiles if t.is_core.any() and t.bounds[2] + t.frame.origin[0] == 85_050.0]
        assert all((t.source == 1).any() for t in west_of_seam)
        assert west_of_seam
