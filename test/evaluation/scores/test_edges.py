"""Edge scores, and the roofs of a reference, on points whose answers are known."""

import math

import numpy as np
import pytest
import shapely

from lidar_buildings.evaluation.scores.edges import (
    alpha_of_spacing,
    fewest_points,
    reference_edges,
    roof_rows,
    roofs_of_points,
    roofs_of_polygons,
    score_edges,
    score_edges_per_roof,
    split_at_steps,
)


def flat_roof(west, south, columns, rows, elevation=10.0, step=0.5):
    x, y = np.meshgrid(west + np.arange(columns) * step, south + np.arange(rows) * step)
    return np.column_stack((x.ravel(), y.ravel(), np.full(x.size, elevation)))


def test_figures_are_those_of_both_classes():
    result = np.array([1, 1, 1, 0, 0, 0, 0, 0, 0, 0], dtype=bool)
    reference = np.array([1, 1, 0, 1, 1, 0, 0, 0, 0, 0], dtype=bool)
    score = score_edges(result, reference)
    assert (score.n_points, score.n_edges_reference, score.n_edges_result) == (10, 4, 3)
    assert score.edge_completeness == 2 / 4
    assert score.edge_correctness == 2 / 3
    assert score.edge_f_score == pytest.approx(2 / (4 / 2 + 3 / 2))
    assert score.non_edge_completeness == 5 / 6
    assert score.non_edge_correctness == 5 / 7
    assert score.non_edge_f_score == pytest.approx(2 / (6 / 5 + 7 / 5))


def test_a_share_of_nothing_is_nan():
    score = score_edges(np.zeros(3, dtype=bool), np.zeros(3, dtype=bool))
    assert math.isnan(score.edge_completeness)
    assert math.isnan(score.edge_correctness)
    assert score.non_edge_f_score == 1.0
    assert math.isnan(score_edges([], []).non_edge_completeness)


def test_the_radius_is_that_of_the_paper_at_its_density():
    assert alpha_of_spacing(1 / math.sqrt(5.0)) == pytest.approx(0.60)
    assert alpha_of_spacing(1.0) == pytest.approx(1.342, abs=5e-4)


def test_each_roof_has_an_alpha_shape_of_its_own():
    houses = np.vstack((flat_roof(0, 0, 10, 8), flat_roof(5, 0, 10, 8)))
    roof = np.repeat([0, 1], 80)
    apart = reference_edges(houses, roof, 0.6)
    assert apart.sum() == 2 * (2 * (10 + 8) - 4)
    together = reference_edges(houses, np.zeros_like(roof), 0.6)
    assert together.sum() == 2 * (20 + 8) - 4
    assert not (together & ~apart).any()
    assert not reference_edges(houses, np.where(roof == 1, -1, 0), 0.6)[80:].any()


def test_scores_of_roofs_add_up_to_that_of_all():
    generator = np.random.default_rng(0)
    result, reference = generator.random((2, 300)) < 0.3
    roof = generator.integers(-1, 5, 300)
    scores = score_edges_per_roof(result, reference, roof, 6)
    assert len(scores) == 6
    assert scores[5].n_points == 0
    known = roof >= 0
    whole = score_edges(result[known], reference[known])
    for name in ("n_points", "n_edges_reference", "n_edges_result"):
        assert sum(getattr(score, name) for score in scores) == getattr(whole, name)
    assert scores[2] == score_edges(result[roof == 2], reference[roof == 2])


def test_rows_of_roofs_leave_out_those_of_none():
    rows = roof_rows(np.array([3, -1, 0, 3, -5, 0]))
    assert [found.tolist() for found in rows] == [[2, 5], [0, 3]]
    assert roof_rows(np.zeros(0, dtype=np.int64)) == []
    assert roof_rows(np.full(3, -1)) == []


def test_points_belong_to_the_first_polygon_that_holds_them():
    polygons = [shapely.box(0, 0, 2, 2), None, shapely.box(1, 0, 4, 2), shapely.Polygon()]
    points = np.array([[0.5, 1, 7], [1.5, 1, 7], [3, 1, 7], [4, 2, 7], [5, 1, 7], [3, 3, 7]])
    assert roofs_of_polygons(points, polygons).tolist() == [0, 0, 2, 2, -1, -1]
    assert roofs_of_polygons(np.zeros((0, 3)), polygons).tolist() == []
    assert roofs_of_polygons(points, []).tolist() == [-1] * 6


def test_a_polygon_that_crosses_itself_is_repaired():
    bow_tie = shapely.Polygon([(0, 0), (2, 2), (2, 0), (0, 2)])
    assert roofs_of_polygons(np.array([[0.2, 1.0, 0], [1.0, 1.5, 0]]), [bow_tie]).tolist() == [0, -1]


def test_parts_of_a_cloud_are_numbered_from_the_west_whatever_the_order():
    east, west, stray = flat_roof(30, 0, 6, 6), flat_roof(0, 0, 6, 6), flat_roof(15, 0, 2, 2)
    cloud = np.vstack((east, west, stray))
    expected = np.repeat([1, 0, -1], [36, 36, 4])
    np.testing.assert_array_equal(roofs_of_points(cloud, 0.8, min_points=5), expected)
    order = np.random.default_rng(0).permutation(len(cloud))
    np.testing.assert_array_equal(roofs_of_points(cloud[order], 0.8, min_points=5), expected[order])
    assert len(set(roofs_of_points(cloud, 0.8).tolist())) == 3
    assert set(roofs_of_points(cloud, 40.0).tolist()) == {0}
    assert roofs_of_points(np.zeros((0, 3)), 1.0).tolist() == []


def test_a_step_parts_roofs_and_a_chimney_stays_with_its_own():
    low, high = flat_roof(0, 0, 20, 20, 10.0), flat_roof(10, 0, 20, 20, 13.0)
    chimney = flat_roof(15, 5, 2, 2, 14.5)
    cloud = np.vstack((low, high, chimney))
    whole = roofs_of_points(cloud, 1.0)
    assert set(whole.tolist()) == {0}
    expected = np.repeat([0, 1, 1], [400, 400, 4])
    np.testing.assert_array_equal(split_at_steps(cloud, whole, 1.0, min_points=10), expected)
    order = np.random.default_rng(1).permutation(len(cloud))
    np.testing.assert_array_equal(split_at_steps(cloud[order], whole, 1.0, min_points=10), expected[order])
    assert set(split_at_steps(cloud, whole, 1.0, min_points=1000).tolist()) == {0}
    assert set(split_at_steps(cloud, np.full(len(cloud), -1), 1.0).tolist()) == {-1}
    assert split_at_steps(np.zeros((0, 3)), np.zeros(0, dtype=int), 1.0).tolist() == []


def test_the_smallest_roof_has_six_square_metres():
    assert fewest_points(1.0) == 6
    assert fewest_points(0.5) == 24
