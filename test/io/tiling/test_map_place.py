"""Where the map of a live feed lies: told, by a fix, or nowhere."""

from dataclasses import replace

import numpy as np
import pyproj
import pytest
from support.level_truth import in_grid
from support.live_feeds import Running, fix, points
from support.scan_messages import SECOND, T0, odometry, scan, transforms

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.scans.placing import ScanPlacer
from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.io.tiling import map_place
from lidar_buildings.io.tiling.live_files import FeedScale, Recorded

#: The frame of odometry that began along a street, in a zone of UTM.
TRUTH = map_place.LevelFrame(map_place.Geodetic(4.4, 52.0, 30.0), "EPSG:32631", yaw=np.radians(40.0))
#: Along that street and then another, with five poses a second: 20 s at 5 m/s.
DRIVE = np.array([[min(k, 60), max(k - 60, 0), 2.0] for k in range(101)])


def place_by_fix(stamp, place, placer):
    fixes = map_place.SatelliteFixes()
    fixes.take(fix(stamp, place.latitude, place.longitude, place.height), placer)
    fixes.pair(placer)
    return fixes.place()


def driven(truth=TRUTH, noise=0.0, ahead=0, wrong=(), **more):
    """Fixes of a drive, of which some are 60 m off; their clock may be ahead [s]."""
    placer, fixes = ScanPlacer(), map_place.SatelliteFixes()
    random = np.random.default_rng(0)
    for k, place in enumerate(DRIVE):
        stamp = T0 + k * SECOND // 5
        placer.add_odometry(odometry(stamp, place, frame="odom", child="base_link"))
        seen = truth.geodetic((place + random.normal(0.0, noise, 3) + 60.0 * (k in wrong))[None])
        message = fix(stamp + ahead * SECOND, seen.latitude[0], seen.longitude[0], seen.height[0])
        vars(message).update(more)
        fixes.take(message, placer)
    fixes.pair(placer)
    return fixes


def off(place, truth=TRUTH):
    """How far the drive is from where it was, at most [m]."""
    drive = DRIVE.astype(float)
    return np.abs(place.level.in_grid(drive) + place.frame.origin - truth.in_grid(drive) - truth.place).max()


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
    found = place_by_fix(T0, map_place.Geodetic(longitude, latitude, 44.0), placer_at(place))
    frame, level = found.frame, found.level
    assert "too little" in found.said
    assert frame.crs == crs
    back = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    x, y, z = frame.to_source(level.in_grid(np.array([place])))[0]
    np.testing.assert_allclose(back.transform(x, y), (longitude, latitude), atol=1e-7)
    assert z == pytest.approx(44.0)


@pytest.mark.parametrize(
    ("away", "origin"),
    [((0.25, -0.5, 1.0), (0.0, 0.0, 0.0)), ((250.0, -500.0, -42.0), (-250.0, 500.0, 42.0))],
)
def test_poses_that_are_told_in_the_grid_are_not_turned_and_as_good_as_fixes(away, origin):
    to_grid = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32631", always_xy=True)
    pose = (*to_grid.transform(4.4, 52.0), 44.0)
    found = place_by_fix(T0, map_place.Geodetic(4.4, 52.0, 44.0), placer_at(np.add(pose, away)))
    assert found.level is None
    np.testing.assert_allclose(found.frame.origin, origin, atol=0.001)


@pytest.mark.parametrize("crs", ["EPSG:32631", "EPSG:32632", "EPSG:28992"])
def test_poses_are_told_in_a_neighbouring_zone_or_in_a_grid_that_fixes_cannot_name(crs):
    pose = pyproj.Transformer.from_crs("EPSG:4979", crs, always_xy=True).transform(5.9, 52.0, 44.0)
    found = place_by_fix(T0, map_place.Geodetic(5.9, 52.0, 44.0), placer_at(pose))
    assert found.level is None
    assert found.frame.crs == ("" if crs == "EPSG:28992" else crs)
    assert any("other than UTM" in one for one in found.warnings) == (crs == "EPSG:28992")


@pytest.mark.parametrize("wrong", [(), (0,), range(0, 101, 3), range(0, 101, 5), range(60, 101)])
def test_odometry_that_began_along_a_street_is_turned_by_its_fixes(wrong):
    place = driven(wrong=wrong).place()
    assert off(place) < 0.01
    assert f"by {101 - len(wrong)} of 101 satellite fixes" in place.said
    assert "40.00° north of east" in place.said
    assert any("contradict" in one for one in place.warnings) == (3 * len(wrong) > 101)


def test_noise_of_fixes_turns_no_odometry_that_points_east():
    truth = map_place.LevelFrame(map_place.Geodetic(4.4, 52.0, 30.0), "EPSG:32631")
    place = driven(truth, noise=2.0).place()
    assert place.level.yaw == 0.0
    assert off(place, truth) < 0.8, "the mean of a hundred fixes, four standard errors"
    assert not place.warnings


@pytest.mark.parametrize("ahead", [18, -18, 37])
def test_the_clock_of_gps_beside_utc_is_corrected_and_reported(ahead):
    place = driven(ahead=ahead).place()
    assert off(place) < 0.01
    assert f"{abs(ahead)} s {'ahead of' if ahead > 0 else 'behind'}" in place.warnings[0]


def test_another_clock_is_told_by_how_far_fixes_are_from_the_poses():
    assert any("m from the poses" in one for one in driven(ahead=-5).place().warnings)
    fixes = driven(ahead=-100)
    assert fixes.place() is None
    assert "by -100.0 s" in fixes.no_place().warnings[0]


def test_fixes_that_tell_how_good_they_are_are_held_to_it():
    told = {"position_covariance_type": 2, "position_covariance": [1e-4, 0, 0, 0, 1e-4, 0, 0, 0, 1e-4]}
    assert not driven(noise=1.5).place().warnings
    assert "1.0 m is usual" in driven(noise=1.5, **told).place().warnings[0]


def test_an_antenna_is_where_transforms_say_that_it_is():
    placer, fixes = ScanPlacer(), map_place.SatelliteFixes()
    placer.add_transforms(transforms((0, "base_link", "gps", (2.0, 0.0, 1.0))), is_static=True)
    for k, place in enumerate(DRIVE):
        placer.add_odometry(odometry(T0 + k * SECOND, place, frame="odom", child="base_link"))
        seen = TRUTH.geodetic(place[None] + [[2.0, 0.0, 1.0]])
        fixes.take(fix(T0 + k * SECOND, seen.latitude[0], seen.longitude[0], seen.height[0]), placer)
    fixes.pair(placer)
    assert off(fixes.place()) < 0.01


def test_scans_of_a_level_frame_lie_in_the_grid_and_do_when_the_feed_goes_on(tmp_path):
    truth = map_place.LevelFrame(map_place.Geodetic(4.4, 52.0, 30.0), "EPSG:32631")
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


def test_where_the_frame_of_the_poses_lies_in_that_of_the_topics_is_said():
    place = driven().place()
    scan_there = PlacedScan(DRIVE[-1:].astype(float), np.zeros(1, np.int64), {})
    recorded = Recorded.beginning(FeedScale(100.0, None), place, scan_there, "odom")
    said = recorded.where_target_lies("map")
    assert said.endswith("--frame-id map --child-frame-id odom")
    x, y, z, yaw = (float(said.split(f"--{name} ")[1].split()[0]) for name in ("x", "y", "z", "yaw"))
    turned = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]) @ DRIVE[-1, :2] + (x, y)
    by_tiles = recorded.placed(scan_there).points[0]
    np.testing.assert_allclose([*turned, DRIVE[-1, 2] + z], by_tiles, atol=0.03)  # but for the scale
    assert "not the odom of the poses" in recorded.where_target_lies("odom")


@pytest.mark.parametrize("wrong", [{"status": -1}, {"latitude": np.nan}, {"longitude": 400.0}])
def test_a_message_without_position_is_no_fix(wrong):
    values = {"latitude": 52.0, "longitude": 4.4, "altitude": 0.0} | wrong
    assert map_place.Fix.of(fix(T0, **values)) is None


def test_where_the_map_lies_is_waited_for_and_then_taken_as_it_is():
    search = map_place.FrameSearch(None)
    assert search.settled(ScanPlacer(), 100.0, 10) is None
    assert search.settled(ScanPlacer(), 101.9, 10) is None
    assert search.settled(ScanPlacer(), 102.0, 10) == map_place.MapPlace()
    told = map_place.FrameSearch(None)
    assert told.settled(ScanPlacer(), 0.0, 10) is None
    told.take_frame(MapFrame("EPSG:28992", (85_000.0, 447_000.0, 3.0)))
    assert told.settled(ScanPlacer(), 0.1, 10) == map_place.MapPlace(
        MapFrame("EPSG:28992", (85_000.0, 447_000.0, 3.0))
    )
    by_fix, placer = map_place.FrameSearch(None), placer_at((0.0, 0.0, 0.0))
    by_fix.fixes.take(fix(T0, 52.0, 4.4, 0.0), placer)
    assert by_fix.settled(placer, 0.0, 10) is None
    assert by_fix.settled(placer, 9.9, 10) is None, "it may move yet, and tell how it is turned"
    assert by_fix.settled(placer, 10.0, 10).frame.crs == "EPSG:32631"
    assert map_place.FrameSearch(None).settled(ScanPlacer(), 0.0, 10_000_000) == map_place.MapPlace(), (
        "memory is bounded"
    )


def test_later_fixes_that_contradict_are_reported_once():
    search, placer = map_place.FrameSearch(None), ScanPlacer()
    for k, place in enumerate(np.concatenate([DRIVE, DRIVE + np.array([0.0, 20.0, 0.0])])):
        stamp = T0 + k * SECOND // 5
        placer.add_odometry(odometry(stamp, place, frame="odom", child="base_link"))
        seen = TRUTH.geodetic(DRIVE[k % 101][None])
        search.fixes.take(fix(stamp, seen.latitude[0], seen.longitude[0], seen.height[0]), placer)
        if k == 100:
            assert search.settled(placer, 0.0, 10) is None
            settled = search.settled(placer, 3.0, 10)
            assert "40.00° north of east" in settled.said, "as it has moved enough"
    (said,) = search.doubts(settled, placer)
    assert "20.0 m" in said
    assert search.doubts(settled, placer) == []


def test_an_origin_far_away_is_moved_so_that_float32_suffices():
    near = MapFrame("EPSG:28992", (10.0, 20.0, 30.0))
    assert map_place.moved_origin(near, np.array([40_000.0, -40_000.0, 0.0])) == near
    in_feet = MapFrame("EPSG:2263", horizontal_unit=0.3048, vertical_unit=0.3048)
    far = map_place.moved_origin(in_feet, np.array([85_321.0, 447_890.0, 3.0]))
    assert far == replace(in_feet, origin=(85_000.0, 448_000.0, 0.0))


def test_scans_far_from_the_origin_keep_their_millimetres():
    places = points(at=(85_320.0, 447_890.0, 3.0))
    with Running(scans=ScanConfig(georeferenced=True)) as run:
        run.feed.add_scan(scan(T0, places, kind="<f8"))
        tiles = run.flush()
    found = np.concatenate([tile.frame.to_source(tile.points[tile.buffer == 0]) for tile in tiles])
    index = np.concatenate([tile.index[tile.buffer == 0] for tile in tiles])
    np.testing.assert_allclose(found[np.argsort(index)], places, atol=2e-4)


#: Low and high, near the middle of a zone of UTM and at its edge, north and south of the equator.
PLACES = [
    (map_place.Geodetic(4.4, 52.0, 44.0), "EPSG:32631"),
    (map_place.Geodetic(151.2, -33.9, 10.0), "EPSG:32756"),
    (map_place.Geodetic(2.9, 43.0, 800.0), "EPSG:32631"),
    (map_place.Geodetic(5.9, 65.0, 2000.0), "EPSG:32631"),
]


def points_within(reach):
    random = np.random.default_rng(0)
    return np.column_stack([random.uniform(-reach, reach, (500, 2)), random.uniform(-100.0, 600.0, 500)])


@pytest.mark.parametrize(("origin", "crs"), PLACES)
def test_points_lie_in_the_grid_where_pyproj_says(origin, crs):
    frame, points = map_place.LevelFrame(origin, crs), points_within(10_000.0)
    truth = in_grid(points, origin, crs) - frame.place
    np.testing.assert_allclose(frame.in_grid(points), truth, atol=1e-6)
    assert np.linalg.norm(points - truth, axis=1).max() > 1.5, "they do not where the grid is taken for level"


@pytest.mark.parametrize(("origin", "crs"), PLACES)
@pytest.mark.parametrize(("n_points", "yaw"), [(1, 0.0), (20, 0.0), (20, 2.5)])
def test_a_frame_is_found_by_points_of_it_seen_by_satellites(origin, crs, n_points, yaw):
    track = np.array([3000.0, -2000.0, 50.0]) + np.outer(np.arange(n_points), [10.0, 2.0, 0.5])
    truth = map_place.LevelFrame(origin, crs, yaw)
    found, fit = map_place.LevelFrame.fitted(track, truth.geodetic(track), np.ones(n_points), crs)
    np.testing.assert_allclose(found.place, truth.place, atol=0.002)
    np.testing.assert_allclose(found.in_grid(track), truth.in_grid(track), atol=0.002)
    assert fit.yaw == pytest.approx(yaw, abs=1e-6)
