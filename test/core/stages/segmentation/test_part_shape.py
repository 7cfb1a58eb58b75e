"""The width of parts from sums over their points."""

import numpy as np
import pytest

from lidar_buildings.core.stages.segmentation.config import SegmentationConfig
from lidar_buildings.core.stages.segmentation.segmentation import segment_buildings
from lidar_buildings.core.stages.segmentation.steps import plan_sums, rectangle_width, spread_width


def rectangle(length, width, deg, seed=0, at=(1000.0, -500.0), density=10.0):
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-0.5, 0.5, (int(density * length * width), 2)) * (length, width)
    cos, sin = np.cos(np.radians(deg)), np.sin(np.radians(deg))
    return np.column_stack((xy @ np.array([[cos, sin], [-sin, cos]]) + at, np.zeros(len(xy))))


@pytest.mark.parametrize("deg", [0.0, 30.0, 45.0, 110.0])
@pytest.mark.parametrize("width", [1.2, 3.0, 8.0])
def test_a_rectangle_has_its_width_however_it_is_turned(width, deg):
    points = rectangle(12.0, width, deg)
    sums = plan_sums(points, np.zeros(len(points), dtype=np.int64), 1)
    assert spread_width(sums[0]) == pytest.approx(width, rel=0.06)


def test_two_halves_that_merge_are_as_wide_as_the_whole():
    points = rectangle(12.0, 6.0, 20.0)
    half = (points[:, 0] > 1000.0).astype(np.int64)
    whole = plan_sums(points, np.zeros(len(points), dtype=np.int64), 1)[0]
    assert spread_width(plan_sums(points, half, 2).sum(axis=0)) == pytest.approx(spread_width(whole))


@pytest.mark.parametrize("n_points", [0, 1, 2])
def test_a_few_points_have_no_width(n_points):
    points = np.arange(3.0 * n_points).reshape(n_points, 3)
    sums = plan_sums(points, np.zeros(n_points, dtype=np.int64), 1)
    assert spread_width(sums[0]) == pytest.approx(0.0, abs=1e-6)


def test_rectangles_have_the_shorter_side_and_what_has_less_rim_than_a_square_the_squares():
    assert rectangle_width(24.0, 20.0) == pytest.approx(4.0)
    assert rectangle_width(25.0, 19.0) == pytest.approx(5.0)


@pytest.mark.parametrize("deg", [0.0, 25.0, 45.0])
def test_a_low_canopy_along_a_wall_is_no_building_of_its_own(deg):
    rng = np.random.default_rng(1)
    hall, canopy = rng.uniform((0, 0), (30, 15), (3600, 2)), rng.uniform((5, 15), (13, 16.6), (102, 2))
    points = np.column_stack((np.concatenate((hall, canopy)), np.repeat((9.0, 4.0), (3600, 102))))
    cos, sin = np.cos(np.radians(deg)), np.sin(np.radians(deg))
    points[:, :2] = points[:, :2] @ np.array([[cos, sin], [-sin, cos]])
    found = segment_buildings(points, SegmentationConfig(split_at_steps=True), point_spacing=0.3536)
    assert len(found.patterns) == 1
