"""Where the map of a live feed lies: told, by a fix, or nowhere."""

import numpy as np
import pyproj
import pytest
from support.level_truth import in_grid
from support.live_feeds import Running, fix, points
from support.scan_messages import SECOND, T0, odometry, scan

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.scans.placing import ScanPlacer
from lidar_buildings.io.tiling.level_frame import Geodetic, LevelFrame
from lidar_buildings.io.tiling.live_frame import Fix, FrameSearch, MapPlace, moved_origin, place_by_fix


def placer_at(place):
    placer = ScanPlacer()
    placer.add_odometry(odometry(T0, place, frame="odom", child="base_link"))
    return placer


@pytest.mark.parametrize(
    ("latitude", "longitude", "crs"),
    [(52.0, 4.4, "EPSG:32631"), (-33.9, 151.2, "EPSG:32756"), (10.0, 180.0, "EPSG:32660")],
)
def test_a_fix_says_where_the_map_lies(latitude, longitude, crs):
    place = (12.0, -7.0, 1.5)
    frame, level = place_by_fix(Fix(T0, Geodetic(longitude, latitude, 44.0)), placer_at(place))
    assert frame.crs == crs
    back = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    x, y, z = frame.to_source(level.in_grid(np.array([place])))[0]
    np.testing.assert_allclose(back.transform(x, y), (longitude, latitude), atol=1e-7)
    assert z == pytest.approx(44.0)


def test_poses_that_are_told_in_the_grid_are_not_turned():
    to_grid = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32631", always_xy=True)
    x, y = to_grid.transform(4.4, 52.0)
    pose = (x + 0.25, y - 0.5, 2.0)
    found = place_by_fix(Fix(T0, Geodetic(4.4, 52.0, 44.0)), placer_at(pose))
    assert found.level is None
    np.testing.assert_allclose(found.frame.origin, (-0.25, 0.5, 42.0), atol=0.001)


def test_scans_of_a_level_frame_lie_in_the_grid_and_do_when_the_feed_goes_on(tmp_path):
    truth = LevelFrame(Geodetic(4.4, 52.0, 30.0), "EPSG:32631")
    places = np.concatenate([points(250, at=(2020.0, 1020.0, 2.0)), points(250, at=(2050.0, 1020.0, 2.0))])
    found = np.full((500, 3), np.nan)
    for k, part in enumerate(np.split(places, 2)):
        with Running(tmp_path) as run:
            if not k:
                seen = truth.geodetic(np.array([2000.0, 1000.0, 80.0]))
                run.feed.add_fix(fix(T0, seen.latitude, seen.longitude, seen.height))
            for step in range(3):
                stamp = T0 + k * SECOND + step * SECOND // 10
                run.feed.add_odometry(odometry(stamp, (2000.0, 1000.0, 80.0), frame="map"))
            run.feed.add_scan(scan(T0 + k * SECOND, part - (2000.0, 1000.0, 80.0)))
            for tile in run.flush():
                assert tile.frame.crs == "EPSG:32631"
                found[tile.index] = tile.frame.to_source(tile.points)
    np.testing.assert_allclose(found, in_grid(places, truth.origin, truth.crs), atol=0.003)


def test_a_fix_without_a_pose_says_nothing():
    there = Geodetic(4.4, 52.0, 0.0)
    assert place_by_fix(Fix(T0 + 10 * SECOND, there), placer_at((0, 0, 0))) is None
    assert place_by_fix(Fix(T0, there), ScanPlacer()) is None


@pytest.mark.parametrize("wrong", [{"status": -1}, {"latitude": np.nan}, {"longitude": 400.0}])
def test_a_message_without_position_is_no_fix(wrong):
    values = {"latitude": 52.0, "longitude": 4.4, "altitude": 0.0} | wrong
    assert Fix.of(fix(T0, **values)) is None


def test_where_the_map_lies_is_waited_for_and_then_taken_as_it_is():
    search = FrameSearch(None)
    assert search.settled(ScanPlacer(), 100.0, 10) is None
    assert search.settled(ScanPlacer(), 101.9, 10) is None
    assert search.settled(ScanPlacer(), 102.0, 10) == MapPlace()
    told = FrameSearch(None)
    assert told.settled(ScanPlacer(), 0.0, 10) is None
    told.take_frame(MapFrame("EPSG:28992", (1.0, 2.0, 3.0)))
    assert told.settled(ScanPlacer(), 0.1, 10) == MapPlace(MapFrame("EPSG:28992", (1.0, 2.0, 3.0)))
    by_fix = FrameSearch(None)
    by_fix.take_fix(fix(T0, 52.0, 4.4, 0.0))
    assert by_fix.settled(placer_at((0.0, 0.0, 0.0)), 0.0, 10).frame.crs == "EPSG:32631"
    assert FrameSearch(None).settled(ScanPlacer(), 0.0, 10_000_000) == MapPlace(), "memory is bounded"


def test_an_origin_far_away_is_moved_so_that_float32_suffices():
    near = MapFrame("EPSG:28992", (10.0, 20.0, 30.0))
    assert moved_origin(near, np.array([40_000.0, -40_000.0, 0.0])) == near
    far = moved_origin(MapFrame("EPSG:28992"), np.array([85_321.0, 447_890.0, 3.0]))
    assert far.origin == (85_000.0, 448_000.0, 0.0)


def test_scans_far_from_the_origin_keep_their_millimetres():
    places = points(at=(85_320.0, 447_890.0, 3.0))
    with Running(scans=ScanConfig(georeferenced=True)) as run:
        run.feed.add_scan(scan(T0, places, kind="<f8"))
        tiles = run.flush()
    found = np.concatenate([tile.frame.to_source(tile.points[tile.buffer == 0]) for tile in tiles])
    index = np.concatenate([tile.index[tile.buffer == 0] for tile in tiles])
    np.testing.assert_allclose(found[np.argsort(index)], places, atol=2e-4)
