"""Files read in parts by other processes: the same tiles as read here."""

import pickle
from concurrent.futures import Future, ProcessPoolExecutor

import numpy as np
import pytest

from lidar_buildings.io.tiling import tiling
from lidar_buildings.io.tiling.tiling import TileSource, TilingConfig
from lidar_buildings.pipeline.building_pool import WorkerLostError

CONFIG = TilingConfig(tile_size=40.0, buffer=20.0, max_buffer=120.0)


@pytest.fixture(scope="module")
def submit():
    with ProcessPoolExecutor(2) as pool:
        yield pool.submit


def small_parts(monkeypatch, n_points):
    monkeypatch.setattr(tiling, "PART", n_points)


def tiles_of(paths, **how):
    with TileSource(paths, CONFIG, **how) as source:
        return [tile.read() for tile in source.ready()], source.problems


def assert_equal(found, expected):
    assert [tile.stamp for tile in found] == [tile.stamp for tile in expected]
    for one, other in zip(found, expected, strict=True):
        assert np.array_equal(one.points, other.points)
        assert (one.point_spacing, one.dark_limit, one.bounds) == (
            other.point_spacing,
            other.dark_limit,
            other.bounds,
        )
        assert one.columns.keys() == other.columns.keys()
        for name, column in one.columns.items():
            assert np.array_equal(column, other.columns[name]), name


@pytest.mark.parametrize(("n_points", "n_ahead"), [(tiling.PART, 1000), (3000, 1000), (3000, 1)])
def test_tiles_are_those_that_are_read_here(village, submit, tmp_path, monkeypatch, n_points, n_ahead):
    expected, _ = tiles_of(village)
    small_parts(monkeypatch, n_points)
    monkeypatch.setattr(tiling, "AHEAD", n_ahead)
    found, problems = tiles_of(village, submit=submit, temporary=tmp_path)
    assert problems == []
    assert len(found) > 10
    assert_equal(found, expected)
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_cut_off_is_told_of_and_the_others_are_read(village, submit, tmp_path, monkeypatch):
    files = sorted(village.glob("*.laz"))
    cut = tmp_path / files[0].name
    cut.write_bytes(files[0].read_bytes()[: files[0].stat().st_size // 2])
    paths = [cut, *files[1:]]
    small_parts(monkeypatch, 3000)
    expected, problems = tiles_of(paths)
    found, told = tiles_of(paths, submit=submit, temporary=tmp_path)
    assert len(told) == len(problems) == 1
    assert str(cut) in told[0]
    assert_equal(found, expected)


def test_a_tile_needs_little_of_the_survey_to_be_sent(village):
    with TileSource(village, CONFIG) as source:
        ready = list(source.ready())
        alone = ready[0].alone()
        sizes = [len(pickle.dumps(one.store.spool)) for one in (alone, ready[0])]
        assert sizes[0] < sizes[1]
        grown = [one.read() for one in (ready[0], alone)]
        assert_equal(grown[1:], grown[:1])
        while alone.grow():
            assert ready[0].grow()
            assert_equal([alone.read()], [ready[0].read()])


def test_a_part_that_no_worker_can_read_costs_its_file_and_is_named(village, tmp_path):
    def submit(read, cloud, source, *place):
        answer = Future()
        if source:
            answer.set_result(read(cloud, source, *place))
        else:
            answer.set_exception(WorkerLostError("workers ended at it"))
        return answer

    first, *others = sorted(village.glob("*.laz"))
    expected, _ = tiles_of(others)
    found, problems = tiles_of(village, submit=submit, temporary=tmp_path)
    assert problems == [f"{first}: no worker can read it: workers ended at it"]
    assert sum(len(tile) for tile in found) == sum(len(tile) for tile in expected)
