"""Messages of a feed become tiles; what is wrong with them is told."""

import json
import re
import threading
import time

import laspy
import numpy as np
import pytest
from support.live_feeds import Running, core, points
from support.scan_messages import SECOND, T0, odometry, scan
from support.waiting import wait_until

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.scans.point_times import N_SCANS
from lidar_buildings.io.tiling import live_feed
from lidar_buildings.io.tiling.live_feed import TOO_FAST, LiveFeed
from lidar_buildings.io.tiling.tiling_config import LiveTilingConfig
from lidar_buildings.pipeline.reconstruct import reconstruct_tile


def test_scans_and_poses_become_tiles_and_files_of_all_points(tmp_path):
    with Running(tmp_path, MapFrame("EPSG:25832", (460_000.0, 5_930_000.0, 0.0))) as run:
        for k in range(4):
            run.feed.add_odometry(odometry(T0 + k * SECOND // 10, (10.0 * k, 0.0, 0.0), frame="map"))
        run.feed.add_scan(scan(T0, points()))
        run.feed.add_scan(scan(T0 + SECOND // 10, points(seed=1)))
        tiles = run.flush()
    assert core(tiles) == 1000
    assert {tile.frame.crs for tile in tiles} == {"EPSG:25832"}
    saved = laspy.read(tmp_path / "clouds" / "points_00000.laz")
    assert len(saved) == 1000
    merged = np.concatenate([tile.points[tile.buffer == 0] for tile in tiles])
    index = np.concatenate([tile.index[tile.buffer == 0] for tile in tiles])
    at = merged[np.argsort(index)] + [460_000.0, 5_930_000.0, 0.0]
    np.testing.assert_allclose(saved.xyz, at, atol=0.001)


def test_scans_of_the_map_need_no_pose_and_nobody_tells_where_it_lies():
    with Running() as run:
        run.feed.add_scan(scan(T0, points(), frame="map"))
        tiles = run.flush()
        assert run.feed.frame == MapFrame()
    assert core(tiles) == 500
    assert not run.feed.folder.exists(), "a temporary folder goes with its feed"


def test_a_feed_goes_on_where_it_was_cut_off(tmp_path):
    first = Running(tmp_path, MapFrame("EPSG:25832", (460_000.0, 5_930_000.0, 0.0)))
    with first:
        first.feed.add_scan(scan(T0, points(), frame="map"))
        (tile,) = first.flush()
    with Running(tmp_path) as second:
        assert second.feed.frame == MapFrame("EPSG:25832", (460_000.0, 5_930_000.0, 0.0))
        assert second.flush() == [], "what was done is not sent again"
        second.feed.add_scan(scan(T0 + SECOND, points(seed=1), frame="map"))
        (again,) = second.flush()
    assert again.stamp == tile.stamp + 1
    assert core([again]) == 1000


def test_points_that_waited_for_where_the_map_lies_are_kept_when_the_feed_ends(tmp_path):
    with Running(tmp_path) as run:
        run.feed.add_scan(scan(T0, points(), frame="map"))
    with Running(tmp_path) as second:
        assert core(second.flush()) == 500


def test_a_tile_is_made_when_it_is_asked_for_with_all_points_there_are_then():
    with Running(frame=MapFrame()) as run:
        run.feed.add_scan(scan(T0, points(), frame="map"))
        run.feed.flush()
        time.sleep(5 * live_feed._TICK)  # long enough to make a tile of the first scan
        run.feed.add_scan(scan(T0 + SECOND, points(400, seed=1), frame="map"))
        wait_until(lambda: run.feed.counts()["points"] == 900)
        tiles = run.flush()
    assert [len(tile) for tile in tiles] == [900]


@pytest.mark.parametrize(
    ("seconds", "why"),
    [
        (None, "no pose leads from the scans' frame 'lidar' .*frames with poses: none"),
        (-3600.0, "scans of 'lidar' wait: they are 3,600.[01] s later than the last pose of it"),
        (
            3600.0,
            "no pose at their time: poses of 'lidar' in 'odom' .*begin after, or end before these points",
        ),
    ],
)
def test_why_no_point_can_be_placed_is_told_once(monkeypatch, seconds, why):
    monkeypatch.setattr(live_feed, "_LACK", 0.0)
    with Running(frame=MapFrame()) as run:
        for k in range(3):
            if seconds is not None:
                run.feed.add_odometry(odometry(T0 + int(seconds * SECOND) + k, (k * 1e-9, 0.0, 0.0)))
            run.feed.add_scan(scan(T0 + k * SECOND // 10, points(seed=k)))
        wait_until(lambda: run.feed.problems)
        time.sleep(5 * live_feed._TICK)  # long enough to be told again
        ((told, count),) = run.feed.problems.items()
    assert re.search(why, told)
    assert count == 1


def test_a_folder_of_other_tiles_is_refused(tmp_path):
    with Running(tmp_path) as run:
        run.feed.add_scan(scan(T0, points(), frame="map"))
        run.flush()
    config = LiveTilingConfig(tile_size=50.0, spool=str(tmp_path))
    with pytest.raises(OutputError, match=r"tile_size.*scan_assembler\.spool"):
        LiveFeed(config, ScanConfig())
    (tmp_path / "survey.json").write_text("{}")
    with pytest.raises(OutputError, match=r"cannot be read .*remove the folder"):
        LiveFeed(config, ScanConfig())


def test_a_feed_that_goes_on_keeps_the_side_that_its_first_seconds_told(tmp_path):
    with Running(tmp_path, tile_size=0.0) as run:
        for k in range(30):
            strip = points(2000, seed=k) * (0.4, 20.0, 1.0) + (4.0 * k, -300.0, 0.0)  # 4 m by 200 m
            run.feed.add_scan(scan(T0 + k * SECOND // 10, strip, frame="map"))
        run.flush()
    noted = (tmp_path / "survey.json").read_text()
    assert 375.0 <= json.loads(noted)["side"] <= 500.0, "2.5 points a square metre"
    with Running(tmp_path, tile_size=0.0) as run:
        run.feed.add_scan(scan(T0 + 4 * SECOND, points(), frame="map"))
        assert core(run.flush()) == 60_500
    assert (tmp_path / "survey.json").read_text() == noted


def flight_over_a_seam():
    """Scans from west to east: points 0.5 m apart, from x = 116 m on 0.7 m; at 100 m houses 1.3 m apart."""
    random = np.random.default_rng(0)
    parts = []
    for x_min, x_max, spacing in ((0.0, 116.0, 0.5), (116.0, 199.0, 0.7)):
        x, y = np.meshgrid(np.arange(x_min, x_max, spacing), np.arange(0.0, 60.0, spacing))
        xy = np.column_stack([x.ravel(), y.ravel()]) + spacing * random.uniform(0.3, 0.7, (x.size, 2))
        parts.append(xy)
    x, y = np.concatenate(parts).T
    is_roof = (((x > 90.0) & (x < 99.3)) | ((x > 100.6) & (x < 114.0))) & (y > 20.0) & (y < 32.0)
    points = np.column_stack([x, y, random.normal(3.0 * is_roof, 0.02)])
    places = np.minimum((x / 5.0).astype(int), 39)
    return [scan(T0 + k * SECOND // 10, points[places == k], frame="map") for k in range(40)]


def test_a_building_at_the_seam_of_tiles_of_other_densities_comes_out_once(tmp_path):
    with Running(tmp_path, tile_size=100.0, buffer=30.0, max_buffer=60.0) as run:
        for one in flight_over_a_seam():
            run.feed.add_scan(one)
        tiles = run.flush()
    noted = json.loads((tmp_path / "survey.json").read_text())["spacing"]
    assert [tile.point_spacing for tile in tiles] == [pytest.approx(noted)] * 2
    outlines = [one.outline.exterior for tile in tiles for one in reconstruct_tile(tile).outlines]
    assert sorted(round(float(one[:, 0].max())) for one in outlines) == [99, 114]


def test_what_cannot_be_read_is_told_and_the_rest_goes_on():
    with Running() as run:
        broken = scan(T0, points(), frame="map")
        broken.data = broken.data[:-10]
        run.feed.add_scan(broken)
        run.feed.add_scan(scan(T0 + 1, points(), frame="map"))
        tiles = run.flush()
        counts = run.feed.counts()
    assert core(tiles) == 500
    assert counts["scans"] == 2
    assert counts["scans that cannot be read"] == 1
    assert any("bytes of data" in problem for problem in run.feed.problems)


def test_a_disk_that_is_full_for_a_while_loses_nothing_and_ends_nothing(tmp_path, monkeypatch):
    record, refused = live_feed.record, threading.Event()

    def full(*given):
        if refused.is_set():
            return record(*given)
        refused.set()
        raise OutputError("no space left")

    monkeypatch.setattr(live_feed, "record", full)
    with Running(tmp_path) as run:
        for k in range(N_SCANS):
            run.feed.add_scan(scan(T0 + k, points(100, seed=k), frame="map"))
        run.feed.add_frame(MapFrame("EPSG:28992"))
        assert refused.wait(240.0)
        run.feed.add_scan(scan(T0 + N_SCANS, points(400, seed=N_SCANS), frame="map"))
        assert core(run.flush()) == 100 * N_SCANS + 400
        assert run.feed.obstacle == ""


def test_a_flush_that_begins_while_files_are_written_is_done_after_another(tmp_path, monkeypatch):
    write, is_first = live_feed.write_placed_points, iter([True])
    with Running(tmp_path, MapFrame("EPSG:25832", (460_000.0, 5_930_000.0, 0.0))) as run:

        def write_and_flush(survey, folder):
            yield from write(survey, folder)
            if next(is_first, False):
                run.feed.add_scan(scan(T0 + SECOND, points(seed=1), frame="map"))
                run.feed.flush()
                wait_until(lambda: not survey.is_flushed)  # it has begun

        monkeypatch.setattr(live_feed, "write_placed_points", write_and_flush)
        run.feed.add_scan(scan(T0, points(), frame="map"))
        run.flush()
        assert run.feed.n_flushed == 1

        def is_flushed():
            if (tile := run.feed.take()) is not None:
                run.feed.finish(tile.stamp)
            return run.feed.n_flushed == 2

        wait_until(is_flushed)
    assert len(laspy.read(tmp_path / "clouds" / "points_00000.laz")) == 1000


def test_scans_beyond_what_memory_is_meant_for_are_counted(monkeypatch):
    monkeypatch.setattr(live_feed, "_MOST_POINTS", 1200)
    run = Running()  # not started: nothing is taken out
    for k in range(3):
        run.feed.add_scan(scan(T0 + k, points(), frame="map"))
    assert run.feed.counts()[f"left out: {TOO_FAST}"] == 500
    with run:
        assert core(run.flush()) == 1000
