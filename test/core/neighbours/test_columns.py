"""Columns hold every point once, and runs lead to all that lies within reach."""

import numpy as np
import pytest

from lidar_buildings.core.neighbours.columns import by_column

POINTS = np.random.default_rng(0).uniform((-20, -20, 0), (20, 20, 9), (600, 3))


@pytest.mark.parametrize(("size", "reach"), [(0.5, 1.0), (0.7, 1.0), (1.0, 1.0), (1.5, 0.6), (0.4, 3.0)])
@pytest.mark.parametrize("share", [1.0, 0.3])
def test_runs_hold_all_points_within_reach_of_a_column_and_none_far_beyond(size, reach, share):
    columns = by_column(POINTS, size)
    runs = columns.around(reach)
    chosen = columns.select(np.random.default_rng(1).random(len(POINTS)) < share)
    for i in range(0, len(POINTS), 7):
        point, own = columns.points[i], runs[columns.column[i]]
        found = np.concatenate([np.arange(chosen.first[a], chosen.first[b]) for a, b in own])
        distance = np.hypot(*(chosen.points - point)[:, :2].T)
        assert set(np.flatnonzero(distance <= reach)) <= set(found)
        assert len(set(found)) == len(found)
        assert distance[found].max(initial=0.0) <= reach + 3 * size


def test_a_selection_leads_back_to_the_points_it_was_taken_from():
    columns = by_column(POINTS, 1.0)
    kept = columns.points[:, 2] > 4
    some = columns.select(kept)
    np.testing.assert_array_equal(some.points, columns.points[some.rows])
    np.testing.assert_array_equal(columns.column[kept], some.column)
    assert len(some.select(np.zeros(len(some.points), dtype=bool)).points) == 0


def test_columns_are_the_same_in_any_order_and_far_apart():
    points = np.vstack([POINTS, POINTS[:50] + np.array([4e6, 9e6, 0])])
    shuffle = np.random.default_rng(2).permutation(len(points))
    straight, shuffled = by_column(points, 1.0), by_column(points[shuffle], 1.0)
    np.testing.assert_array_equal(straight.points, shuffled.points)
    np.testing.assert_array_equal(straight.around(2.0), shuffled.around(2.0))


def test_no_points_have_no_columns():
    columns = by_column(np.zeros((0, 3)), 1.0)
    assert columns.around(2.0).shape[0] == 0
    assert len(columns.select(np.zeros(0, dtype=bool)).points) == 0
