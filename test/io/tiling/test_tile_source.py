"""A source of tiles: stamps, doing without what is done, bad files, its temporary folder, its memory."""

import pickle
import shutil
import threading
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from types import SimpleNamespace

import laspy
import numpy as np
import pytest
from support import cloud_files
from support.cut_surveys import (
    SOUTH,
    WEST,
    all_names,
    core_names,
    grown_fully,
    names,
    square,
    survey,
    tiles_of,
    two_neighbours,
)
from support.long_survey import peak_of_surveys

from lidar_buildings.core.model.errors import InputError, OutputError
from lidar_buildings.core.model.sides import Sides
from lidar_buildings.io.clouds.cloud import Cloud
from lidar_buildings.io.clouds.las import open_cloud
from lidar_buildings.io.tiling.spool import RECORD
from lidar_buildings.io.tiling.tiling import TileSource, TilingConfig


def test_tiles_come_before_the_whole_folder_is_read(tmp_path, monkeypatch):
    paths = survey(tmp_path, [square(50, WEST + 100.0 * k, SOUTH, 100.0, k) for k in range(6)])
    read = []
    plain = Cloud.chunks
    monkeypatch.setattr(Cloud, "chunks", lambda self, size: (read.append(self.path), plain(self, size))[1])
    with TileSource(paths, TilingConfig(tile_size=50.0, buffer=10.0, max_buffer=20.0)) as source:
        next(tiles_of(source))
        assert 0 < len(read) <= 3


def test_the_stamp_is_the_first_core_points_time(tmp_path):
    paths = survey(tmp_path, [square(300, WEST, SOUTH, 100.0)], point_format=1)
    cloud = laspy.read(paths[0])
    cloud.header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    cloud_files.saved(cloud, paths[0])
    with TileSource(paths, TilingConfig(tile_size=50.0)) as source:
        for tile in tiles_of(source):
            gps = float(tile.gps_time[tile.is_core][0])
            assert tile.stamp == round((gps + 1e9 + 315_964_800 - 18) * 1e6) * 1000


def test_tiles_of_one_time_get_stamps_of_their_own(tmp_path):
    paths = survey(tmp_path, [square(300, WEST, SOUTH, 100.0)])
    cloud = laspy.read(paths[0])
    cloud.gps_time[:] = 1000.0
    cloud_files.saved(cloud, paths[0])
    with TileSource(paths, TilingConfig(tile_size=50.0)) as source:
        stamps = [tile.stamp for tile in tiles_of(source)]
    assert stamps == [1000 * 10**9 + 1000 * nudge for nudge in range(4)]


def test_without_times_stamps_are_the_tiles_numbers(tmp_path):
    paths = survey(tmp_path, [square(300, WEST, SOUTH, 100.0)], point_format=0)
    with TileSource(paths, TilingConfig(tile_size=50.0)) as source:
        assert sorted(tile.stamp for tile in tiles_of(source)) == [n * 10**9 for n in (1, 2, 3, 4)]


def test_tiles_that_are_done_are_skipped(tmp_path):
    paths = two_neighbours(tmp_path)
    config = TilingConfig(tile_size=50.0)
    with TileSource(paths, config) as source:
        stamps = [tile.stamp for tile in tiles_of(source)]
    with TileSource(paths, config, skip=set(stamps[::2])) as source:
        assert [tile.stamp for tile in tiles_of(source)] == stamps[1::2]
        assert source.tile_count == len(stamps)


def test_an_unreadable_file_is_reported_and_the_rest_done(tmp_path):
    paths = two_neighbours(tmp_path)
    (tmp_path / "bad.laz").write_bytes(b"no cloud")
    with TileSource([tmp_path / "bad.laz", *paths]) as source:
        assert [file.path for file in source.inputs] == paths
        assert sorted(core_names(tiles_of(source))) == all_names(source)
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
        assert sorted(core_names(tiles_of(source))) == [(0, index) for index in range(400)]
        assert "part_1" in source.problems[0]


def test_a_single_file_that_fails_half_way_is_an_error(tmp_path, monkeypatch):
    failing_after_the_first_chunk(monkeypatch, "part_0")
    with (
        TileSource(survey(tmp_path, [square(100, WEST, SOUTH, 100.0)])) as source,
        pytest.raises(InputError, match=r"part_0\.las"),
    ):
        list(tiles_of(source))


def test_a_missing_temporary_folder_gives_one_line(tmp_path):
    with pytest.raises(OutputError, match="nowhere"):
        TileSource(two_neighbours(tmp_path), temporary=tmp_path / "nowhere")


def test_closing_removes_the_temporary_folder_and_ends_the_iteration(tmp_path):
    (tmp_path / "spool").mkdir()
    source = TileSource(two_neighbours(tmp_path), TilingConfig(tile_size=20.0), temporary=tmp_path / "spool")
    seen, started = [], threading.Event()

    def work():
        for tile in source.ready():
            seen.append(tile)
            started.set()
            if len(seen) == 3:
                resume.wait(240.0)

    resume = threading.Event()
    worker = threading.Thread(target=work)
    worker.start()
    assert started.wait(240.0)
    source.close()
    resume.set()
    worker.join(240.0)
    assert not worker.is_alive()
    assert 1 <= len(seen) <= 4
    assert list((tmp_path / "spool").iterdir()) == []
    assert list(source.ready()) == []


def test_points_stay_decoded_where_there_is_room(tmp_path, monkeypatch):
    sizes = {tmp_path / "a.laz": 3000, tmp_path / "b.las": 2000}
    paths = [
        cloud_files.saved(cloud_files.random_cloud(n, point_format=6), path) for path, n in sizes.items()
    ]
    with TileSource(paths, keep=True) as source:
        assert not source.inputs[0].kept.exists()
        list(source.ready())
        assert source.inputs[1].kept is None, "is not compressed"
        plain = open_cloud(paths[0])
        kept = replace(plain, kept=source.inputs[0].kept)
        assert kept.kept.stat().st_size == 3000 * plain.header.point_format.size
        runs = [(0, 700), (1500, 3000)]
        for (first, one), (place, other) in zip(kept.runs(runs, 500), plain.runs(runs, 500), strict=True):
            assert first == place
            assert np.array_equal(one.array, other.array)
            assert np.array_equal(one.x, other.x)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=1_000_000))
    with TileSource(paths, keep=True) as source:
        assert source.inputs[0].kept is None
    monkeypatch.undo()
    cloud_files.fill_the_disk(monkeypatch, ".part", 1000)
    with TileSource(paths, keep=True) as source, pytest.raises(OutputError, match="free some space"):
        list(tiles_of(source))


def test_a_known_survey_has_the_buffer_that_it_had(tmp_path):
    dense = survey(tmp_path, [square(3000, WEST, SOUTH, 400.0)])
    with TileSource(dense, TilingConfig(max_tile_points=1000)) as source:
        known = source.known
    assert known.buffer == 37.5, "of tiles that hold so few points most would be buffer"
    with TileSource(dense, TilingConfig(buffer=60.0), known=known) as source:
        assert source.known.buffer == 37.5


def test_memory_holds_a_chunk_and_a_tile_whatever_the_size():
    # In a process of its own, where nothing else takes memory. What the first tiles load does not count.
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as own_process:
        n_points, peak = own_process.submit(peak_of_surveys, 2, 100).result()
    assert n_points == 100 * 25_000
    everything = n_points * RECORD.itemsize
    assert peak < everything / 4, f"{peak / 1e6:.0f} MB in memory for {everything / 1e6:.0f} MB of points"


def test_a_tile_waits_for_every_file_that_its_largest_buffer_may_need(tmp_path):
    paths = survey(tmp_path, [square(80, WEST + 100.0 * k, SOUTH, 100.0, k) for k in range(4)])
    config = TilingConfig(tile_size=50.0, buffer=10.0, max_buffer=80.0)
    with TileSource(paths, config) as source, TileSource(paths, config) as patient:
        list(tiles_of(patient))
        for tile in tiles_of(source):
            for early, late in zip(grown_fully(source, tile), grown_fully(patient, tile), strict=True):
                assert names(early) == names(late)


def test_growing_doubles_the_buffer_until_its_cap(tmp_path):
    paths = survey(tmp_path, [square(4000, WEST, SOUTH, 400.0)])
    with TileSource(paths, TilingConfig(tile_size=50.0, buffer=10.0, max_buffer=30.0)) as source:
        tile = max(tiles_of(source), key=len)
        grown = grown_fully(source, tile)
        moved = np.abs([np.subtract(larger.bounds, tile.bounds) for larger in grown])
        west, north, east = 10.0 / 3.0, 20.0 / 3.0, 10.0
        assert moved[:, 0] == pytest.approx([west, 3.0 * west, 7.0 * west, 30.0 - west], abs=1e-4)
        assert moved[:, 3] == pytest.approx([north, 3.0 * north, 30.0 - north, 30.0 - north], abs=1e-4)
        assert moved[:, 2] == pytest.approx([east, 20.0, 20.0, 20.0])
        assert {larger.stamp for larger in grown} == {tile.stamp}
        assert all(names(larger, larger.is_core) == names(tile, tile.is_core) for larger in grown)
        assert source.grown(tile.stamp) is None


def test_a_tile_grows_on_the_sides_that_are_asked_for(tmp_path):
    paths = survey(tmp_path, [square(4000, WEST, SOUTH, 400.0)])
    with TileSource(paths, TilingConfig(tile_size=50.0, buffer=12.0, max_buffer=30.0)) as source:
        tile = max(tiles_of(source), key=len)
        north = source.grown(tile.stamp, Sides(north=True))
        both = source.grown(tile.stamp, Sides(east=True, north=True))
        assert np.subtract(north.bounds, tile.bounds) == pytest.approx([0.0, 0.0, 0.0, 8.0])
        assert np.subtract(both.bounds, tile.bounds) == pytest.approx([0.0, 0.0, 12.0, 22.0])
        assert set(names(tile)) < set(names(north)) < set(names(both))
        assert source.grown(tile.stamp, Sides(north=True)) is None


def test_a_tile_that_was_sent_elsewhere_is_the_same_there(tmp_path):
    paths = survey(tmp_path, [square(4000, WEST, SOUTH, 400.0)])
    with TileSource(paths, TilingConfig(tile_size=50.0, buffer=10.0, max_buffer=30.0)) as source:
        sent = [pickle.loads(pickle.dumps(tile)) for tile in source.ready()]
        for here, there in zip(tiles_of(source), sent, strict=True):
            assert names(here) == names(there.read())
            assert here.point_spacing == there.read().point_spacing
            assert there.grow()
            assert names(source.grown(here.stamp)) == names(there.read())


def test_growing_an_unknown_tile_is_a_mistake(tmp_path):
    with (
        TileSource(two_neighbours(tmp_path)) as source,
        pytest.raises(ValueError, match="stamp = 5: must be"),
    ):
        source.grown(5)
