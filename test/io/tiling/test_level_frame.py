"""A level frame's points lie in a map's grid where pyproj says."""

import numpy as np
import pytest
from support.level_truth import in_grid

from lidar_buildings.io.tiling.level_frame import Geodetic, LevelFrame

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
@pytest.mark.parametrize(("reach", "tolerance"), [(1_000.0, 0.002), (10_000.0, 0.02)])
def test_points_lie_in_the_grid_where_pyproj_says(origin, crs, reach, tolerance):
    frame, points = LevelFrame(origin, crs), points_within(reach)
    truth = in_grid(points, origin, crs) - frame.place
    assert np.abs(frame.in_grid(points) - truth).max() < tolerance
    assert np.linalg.norm(points - truth, axis=1).max() > 1.5, "they do not where the grid is taken for level"


@pytest.mark.parametrize(("origin", "crs"), PLACES)
def test_a_frame_is_found_by_one_of_its_points_seen_by_satellites(origin, crs):
    place = np.array([3000.0, -2000.0, 50.0])
    seen = LevelFrame(origin, crs).geodetic(place)
    np.testing.assert_allclose(LevelFrame.through(place, seen, crs).place, LevelFrame(origin, crs).place)
