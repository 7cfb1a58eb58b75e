"""The spacing from a sample is that from all points."""

import numpy as np
import pytest

from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.core.neighbours.sampled_spacing import sampled_spacing


def cloud(n, shape, seed):
    random = np.random.default_rng(seed)
    xy = random.uniform(0, 1, (n, 2)) * {"square": (30, 30), "strip": (200, 5)}.get(shape, (40, 40))
    if shape == "ell":
        xy = xy[(xy < 15).any(axis=1)]
    if shape == "turned strip":
        xy = xy * (1.0, 0.05) @ np.array([[0.8, 0.6], [-0.6, 0.8]])
    if shape == "two strips":
        xy = np.concatenate([xy, xy[: n // 2] * (0.4, 1.0)])
    points = np.column_stack([xy, random.normal(0, 1, len(xy))])
    return points[np.lexsort(points.T)] + 1e5


@pytest.mark.parametrize("shape", ["square", "strip", "ell", "turned strip", "two strips"])
def test_a_sample_gives_the_spacing_of_all_points(shape):
    for seed in range(4):
        points = cloud(5000, shape, seed)
        assert sampled_spacing(points) == pytest.approx(measure_spacing(points), rel=0.04)


def test_few_points_are_all_taken_and_repeated_positions_count_once():
    points = cloud(250, "square", 1)
    assert sampled_spacing(points) == pytest.approx(measure_spacing(points))
    twice = np.repeat(points, 2, axis=0)
    assert sampled_spacing(twice) == pytest.approx(measure_spacing(points))


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.ones((100, 3)), np.arange(300.0).reshape(-1, 3)])
def test_points_without_area_have_the_spacing_that_they_had(points):
    assert sampled_spacing(points) == measure_spacing(points)


def test_points_on_a_line_along_an_axis_have_one():
    line = np.column_stack([np.arange(500.0), np.zeros(500), np.zeros(500)])
    assert sampled_spacing(line) == measure_spacing(line)
