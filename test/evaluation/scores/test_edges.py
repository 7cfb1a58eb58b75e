"""Edge scores, and the roofs of a reference, on points whose answers are known."""

import math

import numpy as np
import pytest
import shapely

from lidar_buildings.evaluation.scores import edges


def flat_roof(west, south, columns, rows, elevation=10.0, step=0.5):
    x, y = np.meshgrid(west + np.arange(columns) * step, south + np.arange(rows) * step)
    return np.column_stack((x.ravel(), y.ravel(), np.full(x.size, elevation)))


def test_figures_are_those_of_both_classes():
    result = np.array([1, 1, 1, 0, 0, 0, 0, 0, 0, 0], dtype=bool)
    reference = np.array([1, 1, 0, 1, 1, 0, 0, 0, 0, 0], dtype=bool)
    score = edges.score_edges(result, reference)
    assert (score["n_points"], score["n_edges_reference"], score["n_edges_result"]) == (10, 4, 3)
    assert score["edge_completeness"] == 2 / 4
    assert score["edge_correctness"] == 2 / 3
    assert score["edge_f_score"] == pytest.approx(2 / (4 / 2 + 3 / 2))
    assert score["non_edge_completeness"] == 5 / 6
    assert score["non_edge_correctness"] == 5 / 7
    assert score["non_edge_f_score"] == pytest.approx(2 / (6 / 5 + 7 / 5))


def test_a_share_of_nothing_is_nan():
    score = edges.score_edges(np.zeros(3, dtype=bool), np.zeros(3, dtype=bool))
    assert math.isnan(score["edge_completeness"])
    assert math.isnan(score["edge_correctness"])
    assert score["non_edge_f_score"] == 1.0
    assert math.isnan(edges.score_edges([], [])["non_edge_completeness"])


def test_the_radius_is_that_of_the_paper_at_its_density():
    assert edges.alpha_of_spacing(1 / math.sqrt(5.0)) == pytest.approx(0.60)
    assert edges.alpha_of_spacing(1.0) == pytest.approx(1.342, abs=5e-4)


def test_each_roof_has_an_alpha_shape_of_its_own():
    houses = np.vstack((flat_roof(0, 0, 10, 8), flat_roof(5, 0, 10, 8)))
    roof = np.repeat([0, 1], 80)
    apart = edges.reference_edges(houses, roof, 0.6)
    assert apart.sum() == 2 * (2 * (10 + 8) - 4)
    together = edges.reference_edges(houses, np.zeros_like(roof), 0.6)
    assert together.sum() == 2 * (20 + 8) - 4
    assert not (together & ~apart).any()
    assert not edges.reference_edges(houses, np.where(roof == 1, -1, 0), 0.6)[80:].any()


def test_points_belong_to_the_first_polygon_that_holds_them():
    polygons = [shapely.box(0, 0, 2, 2), None, shapely.box(1, 0, 4, 2), shapely.Polygon()]
    points = np.array([[0.5, 1, 7], [1.5, 1, 7], [3, 1, 7], [4, 2, 7], [5, 1, 7], [3, 3, 7]])
    assert edges.roofs_of_polygons(points, polygons).tolist() == [0, 0, 2, 2, -1, -1]
    assert edges.roofs_of_polygons(np.zeros((0, 3)), polygons).tolist() == []
    assert edges.roofs_of_polygons(points, []).tolist() == [-1] * 6


def test_a_polygon_that_crosses_itself_is_repaired():
    bow_tie = shapely.Polygon([(0, 0), (2, 2), (2, 0), (0, 2)])
    assert edges.roofs_of_polygons(np.array([[0.2, 1.0, 0], [1.0, 1.5, 0]]), [bow_tie]).tolist() == [0, -1]


def test_parts_of_a_cloud_are_roofs_whatever_the_order():
    east, west, stray = flat_roof(30, 0, 6, 6), flat_roof(0, 0, 6, 6), flat_roof(15, 0, 2, 2)
    cloud = np.vstack((east, west, stray))
    order = np.random.default_rng(0).permutation(len(cloud))
    for rows in (np.arange(len(cloud)), order):
        roof = np.empty(len(cloud), dtype=int)
        roof[rows] = edges.roofs_of_points(cloud[rows], 0.8, min_points=5)
        assert [len(set(part.tolist())) for part in np.split(roof, [36, 72])] == [1, 1, 1]
        assert roof[0] != roof[36]
        assert roof[72] == -1
    assert len(set(edges.roofs_of_points(cloud, 0.8).tolist())) == 3
    assert set(edges.roofs_of_points(cloud, 40.0).tolist()) == {0}
    assert edges.roofs_of_points(np.zeros((0, 3)), 1.0).tolist() == []


def test_the_smallest_roof_has_six_square_metres():
    assert edges.fewest_points(1.0) == 6
    assert edges.fewest_points(0.5) == 24
