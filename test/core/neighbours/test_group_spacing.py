"""The spacing of groups of points against the spacing measured from all points of each."""

import numpy as np
import pytest

from lidar_buildings.core.neighbours.cell_grid import rows_by_cell
from lidar_buildings.core.neighbours.group_spacing import group_spacings
from lidar_buildings.core.neighbours.point_spacing import measure_spacing


def scattered(n_points, side, at, seed):
    random = np.random.default_rng(seed)
    return np.column_stack((random.uniform(0, side, (n_points, 2)) + at, np.zeros(n_points)))


def spacings_of(clouds, cell=1.0):
    points = np.concatenate(clouds)
    group = np.repeat(np.arange(len(clouds)), [len(one) for one in clouds])
    return group_spacings(points, rows_by_cell(points, cell), group, len(clouds))


def test_groups_of_different_density_that_touch_are_told_apart():
    clouds = [scattered(6000, 30.0, (0.0, 0.0), 1), scattered(800, 20.0, (30.0, 0.0), 2)]
    found = spacings_of(clouds)
    np.testing.assert_allclose(found, [measure_spacing(one) for one in clouds], rtol=0.06)


def test_the_order_of_points_does_not_matter():
    points = scattered(3000, 25.0, (4.0, 9.0), 3)
    shuffled = points[np.random.default_rng(0).permutation(len(points))]
    assert spacings_of([points]) == spacings_of([shuffled])


@pytest.mark.parametrize("n_points", [0, 1, 2, 5])
def test_a_few_points_have_no_spacing(n_points):
    assert np.isnan(spacings_of([scattered(n_points, 3.0, (0.0, 0.0), 4)])).all()


def test_copies_of_one_point_have_no_spacing():
    assert np.isnan(spacings_of([np.ones((200, 3))])).all()


def test_points_of_no_group_are_left_out():
    points = scattered(2000, 20.0, (0.0, 0.0), 5)
    group = np.where(np.arange(2000) % 2, 0, -1)
    found = group_spacings(points, rows_by_cell(points, 1.0), group, 1)
    assert found[0] == pytest.approx(measure_spacing(points[1::2]), rel=0.06)
