"""The files of a feed's points: which are written again."""

import laspy
import numpy as np
import pytest
from support.live_feeds import Running, points
from support.scan_messages import T0, scan

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.io.tiling import live_files, live_survey
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
