"""What a run will take, from headers."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from support import cloud_files

from bench.scale.headers import make_survey
from lidar_buildings.commands.plan import CLUSTER, expected_cost, measure_slowness
from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.clouds import agreement
from lidar_buildings.io.clouds.find_inputs import open_each
from lidar_buildings.io.clouds.las import open_inputs, read_extent
from lidar_buildings.io.tiling.tile_size import plan_survey
from lidar_buildings.io.tiling.tiling import TileSource
from lidar_buildings.io.tiling.tiling_config import TilingConfig


@pytest.fixture(scope="module")
def headers(tmp_path_factory):
    folder = tmp_path_factory.mktemp("headers")
    make_survey(folder, 12, 10_000)
    return folder


def planned(folder, **tiling):
    return plan_survey(open_each(folder, read_extent)[0], TilingConfig(**tiling))


@pytest.mark.parametrize("tiling", [{}, {"tile_size": 60.0, "buffer": 30.0}])
def test_tiles_and_points_are_those_of_the_run(village, tiling):
    plan = planned(village, **tiling)
    with TileSource(village, TilingConfig(**tiling)) as source:
        n_seen = [len(tile.read()) for tile in source.ready()]
        assert plan.n_points == sum(file.point_count for file in source.inputs)
    assert plan.n_tiles == pytest.approx(len(n_seen), rel=0.1), "some reach beyond the last points"
    assert plan.tile_points.sum() == pytest.approx(sum(n_seen), rel=0.1)
    assert plan.area == pytest.approx(280.0**2, rel=0.02)


def test_headers_say_what_opening_the_files_says(tmp_path):
    cloud_files.saved(cloud_files.with_wkt(cloud_files.random_cloud(), "EPSG:28992"), tmp_path / "a.laz")
    clouds, extents = open_inputs(tmp_path)[0], open_each(tmp_path, read_extent)[0]
    for cloud, extent in zip(clouds, extents, strict=True):
        assert (cloud.point_count, cloud.crs) == (extent.point_count, extent.crs)
        assert np.array_equal([cloud.mins, cloud.maxs], [extent.mins, extent.maxs])


def test_headers_tell_what_a_run_takes_and_first_points_what_cannot_be(command, headers):
    """Behind these headers are points that are all the same."""
    told = json.loads("\n".join(command("plan", headers, "--json").out))
    assert (told["files"], told["points"], told["problems"]) == (144, 1_440_000, [])
    spoken = command("plan", headers, "--no-ros")
    assert spoken.status == 0
    assert spoken.out[0].startswith("1,440,000 points in 144 files")
    assert [line.split()[0] for line in spoken.out[4:8]] == ["time", "memory", "temporary", "results"]
    assert sum("x and y and z are the same at all points" in line for line in spoken.out[8:]) == 3
    assert {"code", "text"} == told["remarks"][0].keys()


def test_what_cannot_be_planned_is_said_and_the_rest_planned(command, headers, tmp_path):
    good, bad, wild = tmp_path / "good.las", tmp_path / "bad.las", tmp_path / "wild.las"
    good.write_bytes((headers / "000000.las").read_bytes())
    bad.write_bytes(b"no cloud")
    cloud_files.patched(wild.with_name(good.name).rename(wild), 179, struct.pack("<d", 1e300))
    spoken = command("plan", bad, wild, headers / "000001.las")
    assert spoken.status == 2
    assert [line.split(":")[1].strip() for line in spoken.err] == [str(bad), str(wild)]
    assert spoken.out[0].startswith("10,000 points in 1 file")
    assert "is a bag" in command.refused("plan", Path(__file__).parent / "drive.mcap")


def test_a_plan_says_when_one_run_does_not_take_all_files(command, headers, monkeypatch):
    monkeypatch.setattr(agreement, "MOST_FILES", 143)
    spoken = command("plan", headers, "--no-ros")
    assert spoken.status == 2
    assert spoken.out[0].startswith("1,440,000 points in 144 files")
    assert spoken.err == ["lidar-buildings: 144 input files: at most 143 per run: split the survey"]
    with pytest.raises(InputError, match="144 input files"):
        TileSource([*headers.glob("*.las")])


def test_more_workers_take_less_time_and_more_memory(headers):
    plan = planned(headers, tile_size=50.0)
    few, many = (expected_cost(plan, n, CLUSTER) for n in (2, 20))
    assert many.wall < few.wall
    assert many.memory > few.memory
    assert many.worker_memory == few.worker_memory
    assert expected_cost(plan, 10_000, CLUSTER).wall == pytest.approx(
        expected_cost(plan, plan.n_tiles, CLUSTER).wall
    ), "no more workers than tiles"
    slow = expected_cost(plan, 2, CLUSTER, slowness=2.0)
    assert (slow.wall, slow.memory) == (pytest.approx(2 * few.wall), few.memory)
    assert expected_cost(plan, 2, CLUSTER, "ground_filter").processor < few.processor


def test_a_machine_is_compared_with_the_one_that_was_measured():
    assert 0.05 < measure_slowness() < 20.0
