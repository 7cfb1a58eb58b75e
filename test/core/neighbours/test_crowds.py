"""Of a place that was measured again and again few points stand for all, whichever order they came in."""

import numpy as np
import pytest

from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.neighbours.crowds import MOST, VOXELS_A_COLUMN, without_crowds

SIZE = 0.375
CROWD = np.random.default_rng(0).normal((3.0, -2.0, 1.0), 0.02, (5000, 3))
EVEN = np.random.default_rng(1).uniform((-20, -20, 0), (20, 20, 9), (4000, 3))


def voxels(points):
    return np.floor(VOXELS_A_COLUMN * (points / SIZE))


def test_points_of_an_even_cloud_all_stand_for_themselves():
    is_chosen, place = without_crowds(sort_by_cell(EVEN, SIZE))
    assert is_chosen.all()
    np.testing.assert_array_equal(place, np.arange(len(EVEN)))


def test_a_voxel_keeps_few_points_spread_over_its_heights():
    columns = sort_by_cell(np.vstack([EVEN, CROWD]), SIZE)
    is_chosen, place = without_crowds(columns)
    chosen = columns.points[is_chosen]
    _, of_voxel = np.unique(voxels(chosen), axis=0, return_counts=True)
    assert of_voxel.max() == MOST
    assert len(np.unique(voxels(columns.points), axis=0)) == len(of_voxel)
    np.testing.assert_array_equal(voxels(chosen[place]), voxels(columns.points))
    np.testing.assert_array_equal(place[is_chosen], np.arange(len(chosen)))
    full = (voxels(columns.points) == voxels(CROWD[:1])).all(axis=1)
    heights = np.sort(columns.points[full, 2])
    kept = np.sort(columns.points[full & is_chosen, 2])
    firsts = np.ceil(np.arange(MOST) * len(heights) / MOST).astype(int)
    np.testing.assert_allclose(kept, heights[firsts], atol=1e-3)


def test_the_order_of_the_points_does_not_matter():
    points = np.vstack([EVEN, CROWD])
    shuffled = points[np.random.default_rng(2).permutation(len(points))]
    (one, place), (other, same_place) = (
        without_crowds(sort_by_cell(rows, SIZE)) for rows in (points, shuffled)
    )
    np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(place, same_place)


@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.0), (-4e6, 9e6, -300.0)])
def test_places_far_from_the_origin_and_no_points_are_taken_alike(shift):
    columns = sort_by_cell(CROWD + shift, SIZE)
    is_chosen, place = without_crowds(columns)
    assert 0 < is_chosen.sum() < 0.15 * len(CROWD)
    assert place.max() == is_chosen.sum() - 1
    none = without_crowds(sort_by_cell(np.zeros((0, 3)), SIZE))
    assert [len(one) for one in none] == [0, 0]
