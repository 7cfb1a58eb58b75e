"""A level frame's points lie in a map's grid where PROJ's own steps say."""

import numpy as np
import pytest
from support.level_truth import in_grid

from lidar_buildings.io.tiling.map_place import Geodetic, LevelFrame

#: Low and high, near the middle of a zone of UTM and at its edge, north and south of the equator.
PLACES = [
    (Geodetic(4.4, 52.0, 44.0), "EPSG:32631"),
    (Geodetic(151.2, -33.9, 10.0), "EPSG:32756"),
    (Geodetic(2.9, 43.0, 800.0), "EPSG:32631"),
    (Geodetic(5.9, 65.0, 2000.0), "EPSG:32631"),
]


def points_within(reach):
    random = np.random.default_rng(0)
    return np.column_stack([random.uniform(-reach, reach, (500, 2)), random.uniform(-100.0, 600.0, 500)])


@pytest.mark.parametrize(("origin", "crs"), PLACES)
def test_points_lie_in_the_grid_where_pyproj_says(origin, crs):
    frame, points = LevelFrame(origin, crs), points_within(10_000.0)
    truth = in_grid(points, origin, crs) - frame.place
    np.testing.assert_allclose(frame.in_grid(points), truth, atol=1e-6)
    assert np.linalg.norm(points - truth, axis=1).max() > 1.5, "they do not where the grid is taken for level"


@pytest.mark.parametrize(("origin", "crs"), PLACES)
@pytest.mark.parametrize(("n_points", "yaw"), [(1, 0.0), (20, 0.0), (20, 2.5)])
def test_a_frame_is_found_by_points_of_it_seen_by_satellites(origin, crs, n_points, yaw):
    track = np.array([3000.0, -2000.0, 50.0]) + np.outer(np.arange(n_points), [10.0, 2.0, 0.5])
    truth = LevelFrame(origin, crs, yaw)
    found, fit = LevelFrame.fitted(track, truth.geodetic(track), np.ones(n_points), crs)
    np.testing.assert_allclose(found.place, truth.place, atol=0.002)
    np.testing.assert_allclose(found.in_grid(track), truth.in_grid(track), atol=0.002)
    assert fit.yaw == pytest.approx(yaw, abs=1e-6)
