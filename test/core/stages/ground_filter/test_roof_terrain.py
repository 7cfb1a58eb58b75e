import numpy as np
import pytest

from lidar_buildings.core.stages.ground_filter.growing_tin.roof_terrain import find_roof_terrain

MAX_AREA = 2500.0


def lattice(width, depth, seed=0):
    """Jittered points 1 m apart over a level rectangle about the origin, 2 cm rough."""
    random = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(-width / 2, width / 2), np.arange(-depth / 2, depth / 2))
    xy = np.column_stack((x.ravel(), y.ravel())) + random.uniform(0, 0.8, (x.size, 2))
    return np.column_stack((xy, random.normal(0, 0.02, x.size)))


def roofs_of(candidates, max_area=MAX_AREA):
    """The roofs where every candidate is taken for ground."""
    return find_roof_terrain(candidates, np.ones(len(candidates), dtype=bool), 1.0, max_area)


@pytest.mark.parametrize("east", [0.0, 35.0], ids=["amid the data", "at their edge"])
def test_a_roof_taken_for_ground_is_found_and_nothing_else_is(east):
    points = lattice(80.0, 80.0)
    roof = (abs(points[:, :2] - [east, 0.0]) < [15.0, 12.0]).all(axis=1)
    points[roof, 2] += 6.0
    np.testing.assert_array_equal(roofs_of(points), roof)


def test_what_is_larger_than_allowed_is_a_plateau():
    points = lattice(90.0, 90.0)
    roof = (abs(points[:, :2]) < 20.0).all(axis=1)
    points[roof, 2] += 6.0
    assert not roofs_of(points, max_area=1500.0).any()
    np.testing.assert_array_equal(roofs_of(points, max_area=1700.0), roof)


def test_a_hill_and_a_bank_with_one_gentle_side_are_no_roofs():
    points = lattice(80.0, 80.0)
    points[:, 2] += 8.0 * np.exp(-((np.hypot(*points[:, :2].T) / 14.0) ** 2))
    assert not roofs_of(points).any()
    points = lattice(80.0, 80.0)
    inside = (abs(points[:, :2]) < 15.0).all(axis=1)
    points[inside, 2] += 0.2 * (points[inside, 0] + 15.0)
    assert not roofs_of(points).any()


@pytest.mark.parametrize("height", [1.0, -6.0])
def test_what_hardly_drops_or_lies_lower_is_no_roof(height):
    points = lattice(80.0, 80.0)
    points[(abs(points[:, :2]) < 12.0).all(axis=1), 2] += height
    # The land around a pit drops into it, but is larger than allowed.
    assert not roofs_of(points).any()


def test_a_few_points_above_the_rest_are_too_few_to_tell():
    points = np.vstack((lattice(30.0, 30.0), [[0.0, 0.0, 9.0]]))
    assert not roofs_of(points)[-1]


def test_candidates_that_are_no_ground_have_no_effect_and_are_never_roofs():
    points = lattice(80.0, 80.0)
    roof = (abs(points[:, :2]) < [15.0, 12.0]).all(axis=1)
    points[roof, 2] += 6.0
    assert not find_roof_terrain(points, ~roof, 1.0, MAX_AREA).any()
    # Without ground around it, it may as well be a plateau.
    assert not find_roof_terrain(points, roof, 1.0, MAX_AREA).any()


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        [[1.0, 2.0, 3.0]],
        [[1.0, 2.0, 3.0], [1.5, 2.0, 30.0]],
        [[0.5 * k, 0.0, 9.0 * (k % 2)] for k in range(30)],
        np.ones((20, 3)),
    ],
    ids=["none", "one", "two", "collinear", "identical"],
)
def test_few_or_odd_candidates_are_no_roofs(points):
    found = roofs_of(np.array(points))
    assert found.shape == (len(points),)
    assert not found.any()
