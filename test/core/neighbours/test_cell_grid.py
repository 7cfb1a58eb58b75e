"""Cells hold every point once, and runs lead to all that lies within reach."""

import numpy as np
import pytest

from lidar_buildings.core.neighbours.cell_grid import rows_by_cell, sort_by_cell

POINTS = np.random.default_rng(0).uniform((-20, -20, 0), (20, 20, 9), (600, 3))
NONE = np.zeros((0, 3))


@pytest.mark.parametrize(("size", "reach"), [(0.5, 1.0), (0.7, 1.0), (1.0, 1.0), (1.5, 0.6), (0.4, 3.0)])
@pytest.mark.parametrize("share", [1.0, 0.3])
def test_runs_hold_all_points_within_reach_of_a_cell_and_none_far_beyond(size, reach, share):
    grid = sort_by_cell(POINTS, size)
    runs, asking = grid.around(reach), np.arange(0, len(grid.numbers), 3)
    chosen = grid.select(np.random.default_rng(1).random(len(POINTS)) < share)
    np.testing.assert_array_equal(grid.around(reach, asking), runs[asking])
    np.testing.assert_array_equal(grid.around(reach, north=True), runs[:, runs.shape[1] // 2 :])
    for i in range(0, len(POINTS), 7):
        point, own = grid.points[i], runs[grid.cell[i]]
        found = np.concatenate([np.arange(chosen.first[a], chosen.first[b]) for a, b in own])
        distance = np.hypot(*(chosen.points - point)[:, :2].T)
        assert set(np.flatnonzero(distance <= reach)) <= set(found)
        assert len(set(found)) == len(found)
        assert distance[found].max(initial=0.0) <= reach + 3 * size


def test_a_selection_leads_back_to_the_points_it_was_taken_from():
    grid = sort_by_cell(POINTS, 1.0)
    np.testing.assert_array_equal(POINTS[grid.rows], grid.points)
    kept = grid.points[:, 2] > 4
    some = grid.select(kept)
    np.testing.assert_array_equal(some.points, grid.points[some.rows])
    np.testing.assert_array_equal(grid.cell[kept], some.cell)
    np.testing.assert_array_equal(grid.holding(kept), np.unique(some.cell))
    assert len(some.select(np.zeros(len(some.points), dtype=bool)).points) == 0


def test_cells_lie_at_multiples_of_their_size_and_their_points_rise():
    for grid in (sort_by_cell(POINTS + 100.3, 0.7), rows_by_cell(POINTS + 100.3, 0.7)):
        place = np.floor(grid.points[:, 1::-1] / 0.7)
        np.testing.assert_array_equal(place - place.min(axis=0), grid.places[grid.cell])
    grid = sort_by_cell(POINTS, 4.0)
    assert (np.diff(grid.points[:, 2])[np.diff(grid.cell) == 0] >= 0).all()


def test_cells_are_the_same_in_any_order_and_far_apart():
    points = np.vstack([np.round(POINTS, 1), POINTS[:50] + np.array([4e6, 9e6, 0])])
    shuffle = np.random.default_rng(2).permutation(len(points))
    straight, shuffled = sort_by_cell(points, 1.0), sort_by_cell(points[shuffle], 1.0)
    np.testing.assert_array_equal(straight.points, shuffled.points)
    np.testing.assert_array_equal(straight.around(2.0), shuffled.around(2.0))


@pytest.mark.parametrize(
    "points", [NONE, np.zeros((1, 3)), np.ones((30, 3)), [[-1e12, 0, 0], [1e12, 1e12, 5.0]]]
)
def test_degenerate_clouds_are_legal(points):
    points = np.array(points, dtype=float)
    grid = rows_by_cell(points, 1.0)
    np.testing.assert_array_equal(points[grid.rows], grid.points)
    assert grid.around(2.0 * grid.size).shape == (len(grid.numbers), 5, 2)
