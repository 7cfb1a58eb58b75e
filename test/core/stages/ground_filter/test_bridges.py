import numpy as np
import pytest

from lidar_buildings.core.stages.ground_filter.growing_tin.bridges import MAX_WIDTH, find_decks
from lidar_buildings.core.surfaces.triangulation import build_tin


def lattice(width, depth, spacing=1.0, seed=0):
    """Jittered points over a level rectangle about the origin, 2 cm rough."""
    random = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(-width / 2, width / 2, spacing), np.arange(-depth / 2, depth / 2, spacing))
    xy = np.column_stack((x.ravel(), y.ravel())) + random.uniform(0, 0.8 * spacing, (x.size, 2))
    return np.column_stack((xy, random.normal(0, 0.02, x.size)))


def turned(points, angle_deg):
    """Points turned about the origin."""
    angle = np.deg2rad(angle_deg)
    x, y, z = points.T
    return np.column_stack((np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y, z))


def decks_of(candidates, spacing=1.0):
    """The decks of a terrain that took in every candidate."""
    return find_decks(build_tin(candidates), candidates, spacing)


def road_over_cut(spacing=1.0, width=9.0, depth=7.0):
    """
    A level road along x on a bridge over a cut 36 m wide; which points are its deck; how deep the cut is.
    """
    points = lattice(100.0, 80.0, spacing)
    along, across = abs(points[:, 0]), abs(points[:, 1])
    cut = depth * np.clip((18.0 - along) / 8.0, 0, 1)
    on_road = across < width / 2
    points[~on_road, 2] -= cut[~on_road]
    return points, on_road & (cut > 0), cut


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 75.0])
def test_the_deck_over_a_cut_is_found_and_not_its_approaches(angle_deg):
    points, deck, cut = road_over_cut()
    found = decks_of(turned(points, angle_deg))
    assert found[deck & (cut > 4.0)].mean() > 0.98
    # Pairs of rims that slant reach past the abutments, by no more than their slant over the road's width.
    assert not found[abs(points[:, 0]) > 23.0].any()
    assert not found[~deck & (cut > 4.0)].any()


def test_decks_are_found_where_points_are_far_apart_if_they_are_high_enough():
    # A drop has to be three times as high as the way between its points is long.
    points, deck, cut = road_over_cut(spacing=2.4, width=12.0, depth=16.0)
    found = decks_of(points, 2.4)
    assert found[deck & (cut > 14.0)].mean() > 0.9
    assert not found[abs(points[:, 0]) > 26.0].any()


def test_what_is_wider_than_a_deck_is_none():
    points, _, _ = road_over_cut(width=MAX_WIDTH + 6.0)
    assert not decks_of(points).any()


def test_an_embankment_with_sides_of_35_degrees_is_no_deck():
    points = lattice(60.0, 80.0)
    points[:, 2] += 6.0 * np.clip((5.0 + 6.0 / np.tan(np.deg2rad(35)) - abs(points[:, 1])) / 8.57, 0, 1)
    assert not decks_of(points).any()


def test_a_terrace_that_falls_off_on_one_side_is_no_deck():
    points = lattice(60.0, 60.0)
    points[points[:, 1] > 0, 2] += 8.0
    assert not decks_of(points).any()


def test_terraces_that_step_up_behind_one_another_are_no_decks():
    points = lattice(60.0, 60.0)
    points[:, 2] += 6.0 * np.floor(points[:, 1] / 12.0)
    assert not decks_of(points).any()


def test_a_cut_between_two_walls_is_no_deck():
    # The walls look at each other.
    points = lattice(60.0, 60.0)
    points[abs(points[:, 1]) < 6.0, 2] -= 7.0
    assert not decks_of(points).any()


def test_a_step_lower_than_a_bridge_is_no_deck():
    points = lattice(60.0, 60.0)
    points[abs(points[:, 1]) < 5.0, 2] += 2.0
    assert not decks_of(points).any()


def test_a_slab_that_slants_across_its_length_is_no_deck():
    points = lattice(60.0, 60.0)
    slab = abs(points[:, 1]) < 6.0
    points[slab, 2] += 7.0 + 0.35 * points[slab, 1]
    assert not decks_of(points).any()


def test_where_nothing_drops_there_are_no_rims_and_no_decks():
    points = lattice(40.0, 40.0)
    found = decks_of(points)
    assert found.shape == (len(points),)
    assert found.dtype == bool
    assert not found.any()


def test_the_order_of_candidates_does_not_matter():
    points, _, _ = road_over_cut()
    order = np.random.default_rng(0).permutation(len(points))
    np.testing.assert_array_equal(decks_of(points[order]), decks_of(points)[order])


@pytest.mark.parametrize(
    "points",
    [
        [[1.0, 2.0, 3.0]],
        [[1.0, 2.0, 3.0], [1.5, 2.0, 30.0]],
        [[0.5 * k, 0.0, 9.0 * (k % 2)] for k in range(30)],
        [[0.0, 0.0, 0.0], [1e7, 1e7, 100.0], [1e7, 1e7 + 1.0, 0.0]],
    ],
    ids=["one", "two", "collinear", "huge"],
)
def test_few_or_odd_candidates_get_an_answer_each_and_a_lone_one_is_no_deck(points):
    found = decks_of(np.array(points))
    assert found.shape == (len(points),)
    assert len(points) > 2 or not found.any()
