"""The files of a feed's points: which are written again."""

import laspy
import numpy as np
import pytest
from support.live_feeds import Running, points
from support.scan_messages import SECOND, T0, scan

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.io.tiling import live_files, live_survey
from lidar_buildings.io.tiling.live_files import FeedScale, scale_of
from lidar_buildings.io.tiling.tiling_config import LiveTilingConfig


@pytest.fixture
def files_of(monkeypatch):
    """Let files have so many points."""

    def choose(n_points):
        for module in (live_files, live_survey):
            monkeypatch.setattr(module, "POINTS_PER_FILE", n_points)

    return choose


def test_files_that_are_not_waited_for_are_left_for_the_next_time(tmp_path, files_of):
    files_of(100)
    survey = live_survey.LiveSurvey(LiveTilingConfig(tile_size=40.0), MapFrame(), tmp_path)
    survey.add(PlacedScan(points(450), np.arange(450) + T0, {}), 0.0)
    survey.flush()
    writing = live_files.write_placed_points(survey, tmp_path)
    assert [next(writing) for _ in range(3)] == [5, 4, 3]
    writing.close()
    written = {path: path.stat().st_mtime_ns for path in (tmp_path / "clouds").iterdir()}
    assert len(written) == 2
    assert list(live_files.write_placed_points(survey, tmp_path)) == [5, 4, 3, 2, 1, 0]
    assert [len(laspy.read(path)) for path in sorted((tmp_path / "clouds").iterdir())] == [100] * 4 + [50]
    assert all(path.stat().st_mtime_ns == time for path, time in written.items())
    survey.close()


def test_files_are_in_the_units_of_the_reference_system(tmp_path):
    frame = MapFrame("EPSG:2263", (304_800.0, 60_960.0, 0.0), 0.3048, 0.3048)
    survey = live_survey.LiveSurvey(LiveTilingConfig(tile_size=40.0), frame, tmp_path)
    survey.add(PlacedScan(points(50), np.arange(50) + T0, {}), 0.0)
    survey.flush()
    list(live_files.write_placed_points(survey, tmp_path))
    (path,) = (tmp_path / "clouds").iterdir()
    np.testing.assert_allclose(laspy.read(path).xyz, frame.to_source(points(50)), atol=1e-3)
    survey.close()


def test_no_file_is_left_of_points_that_were_forgotten(tmp_path, files_of):
    files_of(200)
    with Running(tmp_path) as run:
        run.feed.add_scan(scan(T0, points(500), frame="map"))
        run.flush()
        run.feed.reset()
        again = points(300, seed=1)
        run.feed.add_scan(scan(T0 + SECOND, again, frame="map"))
        run.flush()
        written = [laspy.read(path).xyz for path in sorted((tmp_path / "clouds").iterdir())]
    assert [len(xyz) for xyz in written] == [200, 100]
    np.testing.assert_allclose(np.concatenate(written), again, atol=1e-3)


def test_full_files_are_not_written_again(tmp_path, files_of):
    files_of(400)
    with Running(tmp_path) as run:
        run.feed.add_scan(scan(T0, points(), frame="map"))
        run.flush()
        first, second = sorted((tmp_path / "clouds").iterdir())
        times = first.stat().st_mtime_ns, second.stat().st_mtime_ns
        run.feed.add_scan(scan(T0 + 1, points(100, seed=1), frame="map"))
        tiles = run.flush()
    assert first.stat().st_mtime_ns == times[0]
    assert second.stat().st_mtime_ns != times[1]
    assert [len(laspy.read(path)) for path in (first, second)] == [400, 200]
    assert sorted(set(tiles[-1].source.tolist())) == [0, 1]


BUFFER = 75.0
SPEED, WIDTH = 40.0, 200.0


def strip(density, seconds=3.0, width=WIDTH):
    """What an airborne scanner measures, in scans of 0.1 s."""
    random = np.random.default_rng(0)
    found = []
    for k in range(round(10 * seconds)):
        n = round(density * SPEED * width * 0.1)
        time = np.sort(random.uniform(0.1 * k, 0.1 * (k + 1), n))
        x, y = SPEED * time, random.uniform(0.0, width, n)
        times = T0 + np.round(time * SECOND).astype(np.int64)
        found.append(PlacedScan(np.column_stack([x, y, 0 * x]), times, {}))
    return found


def turns(n_points=30_000, seconds=3.0, speed=8.0):
    """What a scanner on the street measures, that turns ten times a second."""
    random = np.random.default_rng(0)
    found = []
    for k in range(round(10 * seconds)):
        time = np.sort(random.uniform(0.1 * k, 0.1 * (k + 1), n_points))
        angle, distance = random.uniform(0.0, 2 * np.pi, n_points), random.uniform(2.0, 60.0, n_points)
        xy = np.column_stack([distance * np.cos(angle) + speed * time, distance * np.sin(angle)])
        times = T0 + np.round(time * SECOND).astype(np.int64)
        found.append(PlacedScan(np.column_stack([xy, np.zeros(n_points)]), times, {}))
    return found


@pytest.mark.parametrize("density", [2.2, 4.0, 8.0])
def test_a_strip_brings_no_more_than_600_000_points_into_a_tile_with_its_buffer(density):
    side = scale_of(strip(density), BUFFER).side
    assert side % 25.0 == 0.0
    assert density * (side + 100.0) ** 2 <= 1.1 * 0.6e6 < 1.1 * density * (side + 125.0) ** 2


def test_tiles_are_no_smaller_than_is_worth_their_buffer_and_no_larger_than_files():
    assert scale_of(strip(60.0), BUFFER).side == 150.0
    assert scale_of(strip(0.4, width=500.0), BUFFER).side == 1000.0


@pytest.mark.parametrize("density", [2.2, 6.0, 12.0])
def test_a_strip_tells_the_spacing_of_what_is_left_behind(density):
    spacing = scale_of(strip(density), BUFFER).spacing
    assert spacing * density**0.5 == pytest.approx(1.0, rel=0.12), "rounded by up to 9 %"
    assert (4.0 * np.log2(spacing)) % 1.0 == pytest.approx(0.0, abs=1e-9)


def test_few_points_tell_no_spacing():
    assert scale_of(strip(0.02), BUFFER).spacing is None


@pytest.mark.parametrize("speed", [0.0, 8.0])
def test_a_scanner_that_measures_the_same_places_again_gets_small_tiles_each_with_its_own_spacing(speed):
    assert scale_of(turns(2000, speed=speed), BUFFER) == FeedScale(150.0, None)


def test_points_are_waited_for_unless_no_more_come():
    early = strip(6.0, seconds=1.0)
    assert scale_of(early, BUFFER) is None
    assert scale_of(early, BUFFER, is_end=True) is not None


def test_what_comes_later_does_not_tell():
    long, short = strip(6.0, seconds=6.0), strip(6.0, seconds=6.0)[:21]
    assert scale_of(long, BUFFER) == scale_of(short, BUFFER)
