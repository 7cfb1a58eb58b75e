import numpy as np
import pytest

from lidar_buildings.core.neighbours.cell_grid import rows_by_cell
from lidar_buildings.core.neighbours.point_spacing import (
    FALLBACK_SPACING,
    given_or_measured,
    group_spacings,
    measure_spacing,
    quantised_spacing,
)


def square_lattice(step, side=40):
    x, y = np.meshgrid(np.arange(side) * step, np.arange(side) * step)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def poisson_cloud(density, side, seed=0):
    rng = np.random.default_rng(seed)
    n = int(density * side * side)
    return np.column_stack([rng.uniform(0, side, (n, 2)), rng.normal(0, 5, n)])


@pytest.mark.parametrize("step", [0.1, 0.5, 2.2])
def test_the_spacing_of_a_lattice_is_its_step(step):
    # The 16 neighbours of a lattice point fill a disc that a Poisson process would fill to within 0.2 %.
    assert measure_spacing(square_lattice(step)) == pytest.approx(step, rel=0.02)


@pytest.mark.parametrize("density", [0.2, 4.0, 60.0])
def test_the_spacing_is_one_over_the_root_of_the_density(density):
    side = np.sqrt(10_000 / density)
    assert measure_spacing(poisson_cloud(density, side)) == pytest.approx(1 / np.sqrt(density), rel=0.04)


def test_unequal_steps_along_and_across_the_scan_give_the_mean_density():
    cloud = square_lattice(1.0, 60) * [0.5, 1.5, 1]
    assert measure_spacing(cloud) == pytest.approx(np.sqrt(0.5 * 1.5), rel=0.15)


def test_holes_do_not_count_as_sparse_ground():
    cloud = poisson_cloud(4.0, 60)
    ring = np.hypot(cloud[:, 0] - 30, cloud[:, 1] - 30) > 20
    assert measure_spacing(cloud[ring]) == pytest.approx(0.5, rel=0.06)


def test_an_overlap_of_strips_over_a_third_of_the_area_changes_little():
    cloud = poisson_cloud(4.0, 60)
    overlap = poisson_cloud(4.0, 60, seed=1)
    both = np.vstack([cloud, overlap[overlap[:, 0] < 20]])
    assert measure_spacing(both) == pytest.approx(0.5, rel=0.12)


def test_repeated_positions_count_once():
    cloud = poisson_cloud(4.0, 40)
    assert measure_spacing(np.vstack([cloud, cloud, cloud])) == measure_spacing(cloud)


def test_the_order_of_points_does_not_matter():
    cloud = poisson_cloud(4.0, 120)
    shuffled = np.random.default_rng(3).permutation(cloud)
    assert measure_spacing(shuffled) == measure_spacing(cloud)


def test_a_small_roof_is_measured_to_a_quarter():
    roof = poisson_cloud(5.0, 4.0)
    assert measure_spacing(roof) == pytest.approx(1 / np.sqrt(5), rel=0.25)


@pytest.mark.parametrize("n", [0, 1, 7])
def test_fewer_than_two_positions_give_the_fallback(n):
    points = np.full((n, 3), 12.5)
    assert measure_spacing(points) == FALLBACK_SPACING
    assert quantised_spacing(points) == FALLBACK_SPACING


def test_points_on_a_line_have_a_finite_spacing():
    line = np.column_stack([np.arange(100.0), np.zeros(100), np.zeros(100)])
    assert 0.5 < measure_spacing(line) < 10


def test_quantised_spacings_lie_on_a_geometric_series_within_nine_percent():
    for density in (0.3, 1.0, 7.7, 31.0):
        cloud = poisson_cloud(density, np.sqrt(4000 / density))
        quantised = quantised_spacing(cloud)
        assert quantised == pytest.approx(measure_spacing(cloud), rel=0.091)
        assert 4 * np.log2(quantised) == pytest.approx(round(4 * np.log2(quantised)), abs=1e-9)


@pytest.mark.parametrize("bad", [np.zeros((3, 2)), np.zeros(3), np.array([[0, np.nan, 0]])])
def test_unusable_points_are_refused_by_name(bad):
    with pytest.raises(ValueError, match="points"):
        measure_spacing(bad)


def test_a_few_strays_far_off_have_no_say():
    cloud = poisson_cloud(4.0, 40)
    strays = np.column_stack([np.arange(20) * 500.0 + 1000, np.zeros(20), np.zeros(20)])
    assert measure_spacing(np.vstack([cloud, strays])) == pytest.approx(0.5, rel=0.05)


def test_a_given_spacing_is_taken_and_must_be_a_length():
    cloud = square_lattice(0.5, 20)
    assert given_or_measured(cloud, 0.7) == 0.7
    assert given_or_measured(cloud, None) == quantised_spacing(cloud)
    for wrong in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="point_spacing"):
            given_or_measured(cloud, wrong)


def test_distances_beyond_all_numbers_are_refused_or_none():
    assert quantised_spacing([[0.0, 0.0, 0.0], [5e-324, 0.0, 0.0]]) == 1.0
    with pytest.raises(ValueError, match="must be finite, and within"):
        quantised_spacing(np.random.default_rng(0).uniform(-1e200, 1e200, (50, 3)))


def spacings_of(clouds):
    """Return the spacings of several clouds as groups of one."""
    points = np.concatenate(clouds)
    group = np.repeat(np.arange(len(clouds)), [len(one) for one in clouds])
    return group_spacings(points, rows_by_cell(points, 1.0), group, len(clouds))


def test_groups_of_different_density_that_touch_are_told_apart_in_any_order():
    clouds = [poisson_cloud(6.7, 30), poisson_cloud(2.0, 20, seed=2) + np.array([30.0, 0.0, 0.0])]
    found = spacings_of(clouds)
    np.testing.assert_allclose(found, [measure_spacing(one) for one in clouds], rtol=0.06)
    np.testing.assert_array_equal(spacings_of([one[::-1] for one in clouds]), found)


@pytest.mark.parametrize("points", [np.zeros((0, 3)), poisson_cloud(0.5, 3.0), np.ones((200, 3))])
def test_few_or_equal_points_have_no_spacing(points):
    assert np.isnan(spacings_of([points])).all()


def test_positions_that_repeat_count_once_in_groups_too():
    points = poisson_cloud(5.0, 20)
    repeated = spacings_of([np.repeat(points, 3, axis=0)])
    np.testing.assert_allclose(repeated, spacings_of([points]), rtol=0.06)  # of other probes


def test_points_of_no_group_are_left_out():
    points = poisson_cloud(5.0, 20)
    group = np.where(np.arange(2000) % 2, 0, -1)
    found = group_spacings(points, rows_by_cell(points, 1.0), group, 1)
    assert found[0] == pytest.approx(measure_spacing(points[1::2]), rel=0.06)
